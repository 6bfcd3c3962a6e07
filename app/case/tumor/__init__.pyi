from .built_tumor import (
    SEGMENTATION_ENDING,
    BuiltTumor,
    LabelMap,
    read_segment,
    tumor_from_contour,
    tumor_from_segmentation,
)
from .nrrd_file import NrrdVolume, read_nrrd
from .surfaces import surface_around, surface_of_labels

__all__ = [
    "SEGMENTATION_ENDING",
    "BuiltTumor",
    "LabelMap",
    "NrrdVolume",
    "read_nrrd",
    "read_segment",
    "surface_around",
    "surface_of_labels",
    "tumor_from_contour",
    "tumor_from_segmentation",
]
