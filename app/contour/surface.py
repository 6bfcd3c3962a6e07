"""From a contour to a tumour: the closed surface of its points, dilated, with its uncertainty."""

from dataclasses import dataclass

from app.case.tumor import surface_around
from app.contour.hydromark import hydromark_surface
from app.contour.outline import require_simple_outlines
from app.contour.points import Contour
from app.contour.uncertainty import ContourUncertainty, spacing_sigma
from app.fixture import margin_surface
from app.geometry import MeshError, SurfaceMesh

MAX_DILATION_MM = 20.0
_SPACING_MM = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ContourSurface:
    """``mesh``: closed, in the contour's frame. ``uncertainty``: None without a calibration's."""

    mesh: SurfaceMesh
    uncertainty: ContourUncertainty | None


def contour_surface(contour: Contour, pixel_sigma_mm: float) -> ContourSurface:
    """The convex hull of the points, rounded outward, all points inside; then dilated.

    Points of a hydromark are inside of it: its surface is around them at its radius, dilated.

    The hull is that of `app.case.tumor.surface_around`, as for a contour in a file, so that
    hollows are filled as in LumpNav. ``pixel_sigma_mm``: standard deviation of a click. Raises
    `MeshError` in one line for fewer than four points, points that are nearly in one plane, an
    outline that crosses itself, and a dilation out of range.
    """
    dilation_mm = contour.dilation_mm
    if not 0.0 <= dilation_mm <= MAX_DILATION_MM:
        raise MeshError(
            f"dilation of the contour: is {dilation_mm:.6g} mm; "
            f"expected 0 to {MAX_DILATION_MM:g} mm"
        )
    if contour.hydromark_mm:
        return _hydromark(contour, pixel_sigma_mm)
    require_simple_outlines(contour)
    points = contour.positions_mm
    if len(points) < 4:
        raise MeshError(
            f"contour: {len(points)} points; expected 4 or more that are not in one plane"
        )
    mesh = surface_around(points, contour.frame)
    uncertainty = None
    if contour.calibration_mm is not None:
        uncertainty = ContourUncertainty(
            contour.calibration_mm, pixel_sigma_mm, spacing_sigma(mesh, points)
        )
    if dilation_mm > 0.0:
        mesh = margin_surface(mesh, dilation_mm, spacing_mm=_SPACING_MM)
    return ContourSurface(mesh, uncertainty)


def _hydromark(contour: Contour, pixel_sigma_mm: float) -> ContourSurface:
    mesh = hydromark_surface(
        contour.positions_mm, contour.hydromark_mm, contour.dilation_mm, contour.frame
    )
    if contour.calibration_mm is None:
        return ContourSurface(mesh, None)
    # The shape is given: nothing is guessed between the points.
    uncertainty = ContourUncertainty(contour.calibration_mm, pixel_sigma_mm, spacing_mm=0.0)
    return ContourSurface(mesh, uncertainty)
