"""A contour in words, the same on the page and in the panel."""

import numpy as np

from app.contour.points import Contour
from app.contour.surface import ContourSurface
from app.contour.uncertainty import ContourUncertainty


def contour_count(contour: Contour) -> str:
    """The number of points, and the places where they were set."""
    if not contour.points:
        return "no points"
    at_tip = sum(each.image is None for each in contour.points)
    images = len(contour.images)
    places = [f"{images} image{'s' * (images != 1)}"] if images else []
    places += [f"{at_tip} at the tip"] if at_tip else []
    count = len(contour.points)
    return f"{count} point{'s' * (count != 1)}, {', '.join(places)}"


def contour_size(surface: ContourSurface) -> str:
    """Volume and sides of the surface."""
    low, high = surface.mesh.bounds_mm
    sides = " x ".join(f"{side:.1f}" for side in np.subtract(high, low))
    return f"{surface.mesh.signed_volume_mm3 / 1000.0:.2f} cm\N{SUPERSCRIPT THREE}, {sides} mm"


def contour_sigma(uncertainty: ContourUncertainty) -> str:
    """Standard deviation of the surface and its parts."""
    return (
        f"{uncertainty.sigma_mm:.2f} mm: calibration {uncertainty.calibration_mm:.2f}, "
        f"pixel {uncertainty.pixel_mm:.2f}, spacing of the points {uncertainty.spacing_mm:.2f}"
    )
