"""A contour as values of the page."""

from typing import Any

import numpy as np

from app.contour import Contour, ContourSurface


def contour_values(
    contour: Contour, surface: ContourSurface | None, problem: str, *, is_computed: bool
) -> dict[str, Any]:
    """Points, volume, size and uncertainty of a contour; ``problem``: why it has no surface.

    Points are in pixels, from 0 at the outer edge of the first pixel. ``is_computed``: surface and
    problem are those of these points.
    """
    uncertainty = None if surface is None else surface.uncertainty
    return {
        "points": [
            {
                "n": each.number,
                "image": each.image,
                "x": round(each.pixel[0] + 0.5, 2),
                "y": round(each.pixel[1] + 0.5, 2),
            }
            for each in contour.points
            if each.pixel is not None
        ],
        "count": _count(contour),
        "text": "" if surface is None else _size(surface),
        "problem": problem if contour.points else "",
        "dilation": contour.dilation_mm,
        "calibration": contour.calibration_mm,
        "sigma": ""
        if uncertainty is None
        else f"{uncertainty.sigma_mm:.2f} mm: calibration {uncertainty.calibration_mm:.2f}, "
        f"pixel {uncertainty.pixel_mm:.2f}, spacing of the points {uncertainty.spacing_mm:.2f}",
        "sigma_mm": "" if uncertainty is None else f"{uncertainty.sigma_mm:.2f}",
        "computed": is_computed,
        "ready": is_computed and uncertainty is not None,
    }


def _count(contour: Contour) -> str:
    if not contour.points:
        return "no points"
    at_tip = sum(each.image is None for each in contour.points)
    images = len(contour.images)
    places = [f"{images} image{'s' * (images != 1)}"] if images else []
    places += [f"{at_tip} at the tip"] if at_tip else []
    count = len(contour.points)
    return f"{count} point{'s' * (count != 1)}, {', '.join(places)}"


def _size(surface: ContourSurface) -> str:
    low, high = surface.mesh.bounds_mm
    sides = " x ".join(f"{side:.1f}" for side in np.subtract(high, low))
    return f"{surface.mesh.signed_volume_mm3 / 1000.0:.2f} cm\N{SUPERSCRIPT THREE}, {sides} mm"
