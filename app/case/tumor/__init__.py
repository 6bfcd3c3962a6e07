"""A tumour's surface from what surgeons mark: contoured points, or a segment of a volume."""

from app.case.tumor.contour_surface import surface_around
from app.case.tumor.label_surface import surface_of_labels
from app.case.tumor.nrrd_file import NrrdVolume, read_nrrd
from app.case.tumor.segmentation import LabelMap, read_segment
from app.case.tumor.sources import (
    SEGMENTATION_ENDING,
    BuiltTumor,
    tumor_from_contour,
    tumor_from_segmentation,
)

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
