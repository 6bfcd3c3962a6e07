"""A contour as values of the page."""

from typing import Any

from app.contour import Contour, ContourSurface, contour_count, contour_sigma, contour_size


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
        "count": contour_count(contour),
        "text": "" if surface is None else contour_size(surface),
        "problem": problem if contour.points else "",
        "dilation": contour.dilation_mm,
        "calibration": contour.calibration_mm,
        "hydromark": contour.hydromark_mm,
        "sigma": "" if uncertainty is None else contour_sigma(uncertainty),
        "sigma_mm": "" if uncertainty is None else f"{uncertainty.sigma_mm:.2f}",
        "computed": is_computed,
        "ready": is_computed and uncertainty is not None,
    }
