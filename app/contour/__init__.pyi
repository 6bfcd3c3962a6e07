from .editor import MAX_POINTS, Change, Contour, ContourEditor, ContourPoint
from .surface import (
    MAX_DILATION_MM,
    MAX_RADIUS_MM,
    ContourSurface,
    ContourUncertainty,
    contour_count,
    contour_sigma,
    contour_size,
    contour_surface,
    hydromark_surface,
)

__all__ = [
    "MAX_DILATION_MM",
    "MAX_POINTS",
    "MAX_RADIUS_MM",
    "Change",
    "Contour",
    "ContourEditor",
    "ContourPoint",
    "ContourSurface",
    "ContourUncertainty",
    "contour_count",
    "contour_sigma",
    "contour_size",
    "contour_surface",
    "hydromark_surface",
]
