"""Points that an operator places on a tumour, in the frame that the tumour moves with."""

from dataclasses import dataclass, replace

import numpy as np

from app.geometry import FloatArray, InputError

MAX_POINTS = 300
"""Points of a contour; its surface is computed in a tenth of a second."""

Pixel = tuple[float, float]
"""Column and row, 0 at the centre of the first pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class ContourPoint:
    """Point ``number`` at ``position_mm`` (3,), unique within its contour.

    ``image`` and ``pixel``: where it was placed; None for a point at a tool's tip.
    ``changed``: the revision of the contour in which it was placed or moved last.
    """

    number: int
    position_mm: FloatArray
    image: int | None = None
    pixel: Pixel | None = None
    changed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Contour:
    """Points in ``frame``. Those of one image are in the order of its outline, which is closed.

    ``dilation_mm``: by how much their surface is dilated. ``calibration_mm``: standard deviation of
    a point's place by the calibration of probe or tip; None until it is stated.
    ``hydromark_mm``: above 0 the points mark a clip of that radius, and are not on a surface.
    """

    frame: str
    points: tuple[ContourPoint, ...] = ()
    dilation_mm: float = 0.0
    calibration_mm: float | None = None
    hydromark_mm: float = 0.0

    @property
    def positions_mm(self) -> FloatArray:
        """Positions (n, 3)."""
        return np.array([point.position_mm for point in self.points]).reshape(-1, 3)

    @property
    def images(self) -> tuple[int, ...]:
        """The images with points, ascending."""
        return tuple(sorted({each.image for each in self.points if each.image is not None}))

    def outline(self, image: int) -> tuple[ContourPoint, ...]:
        """The points of ``image`` in order; the last one is followed by the first."""
        return tuple(point for point in self.points if point.image == image)

    def point(self, number: int) -> ContourPoint | None:
        """The point with this number; None if there is none."""
        return next((each for each in self.points if each.number == number), None)

    def added(self, point: ContourPoint) -> "Contour":
        """The contour with ``point``, where it lengthens the outline of its image least.

        Raises `InputError` above `MAX_POINTS`.
        """
        if len(self.points) >= MAX_POINTS:
            raise InputError(f"contour: {len(self.points)} points; expected at most {MAX_POINTS}")
        place = len(self.points)
        if point.image is not None:
            outline = self.outline(point.image)
            if len(outline) >= 3:
                place = self.points.index(outline[_place(outline, point)]) + 1
        return replace(self, points=(*self.points[:place], point, *self.points[place:]))

    def moved(self, moved: ContourPoint) -> "Contour":
        """The contour with ``moved`` instead of the point of its number."""
        points = (moved if each.number == moved.number else each for each in self.points)
        return replace(self, points=tuple(points))

    def erased(self, centre_mm: FloatArray, radius_mm: float) -> "Contour":
        """The contour without the points nearer than ``radius_mm`` to ``centre_mm`` (3,)."""
        kept = (
            each for each in self.points if np.linalg.norm(each.position_mm - centre_mm) > radius_mm
        )
        return replace(self, points=tuple(kept))


def _place(outline: tuple[ContourPoint, ...], point: ContourPoint) -> int:
    """Index of the point of ``outline`` after which ``point`` lengthens it least."""
    begins = np.array([each.position_mm for each in outline])
    ends = np.roll(begins, -1, axis=0)
    there, back = point.position_mm - begins, ends - point.position_mm
    longer = (
        np.linalg.norm(there, axis=1)
        + np.linalg.norm(back, axis=1)
        - np.linalg.norm(ends - begins, axis=1)
    )
    return int(np.argmin(longer))
