from .editor import Change, ContourEditor
from .hydromark import MAX_RADIUS_MM, hydromark_surface
from .points import MAX_POINTS, Contour, ContourPoint
from .surface import MAX_DILATION_MM, ContourSurface, contour_surface
from .text import contour_count, contour_sigma, contour_size
from .uncertainty import ContourUncertainty

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
