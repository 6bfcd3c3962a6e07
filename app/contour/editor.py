"""Contour of a tumour: points that operators place, in the frame that the tumour moves with.

Several pages may edit one contour: each change has an author, and undo restores all.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from app.geometry import FloatArray, InputError

MAX_POINTS = 300
"""Points of a contour; its surface is computed in a tenth of a second."""

Pixel = tuple[float, float]
"""Column and row, 0 at the centre of the first pixel."""
MAX_UNDO = 200


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


@dataclass(frozen=True, slots=True)
class Change:
    """Who changes, and which revision of the contour that one has seen."""

    author: str
    seen: int


class ContourEditor:
    """A contour with its history. Not thread-safe.

    ``revision`` counts the changes. A change of what another author has changed since the revision
    that was seen raises `InputError` and changes nothing: no work of the other one is lost. Points
    may be added at any time, because that loses nothing.
    """

    def __init__(self, frame: str) -> None:
        self.contour = Contour(frame)
        self.revision = 0
        self._number = 0
        self._undo: deque[Contour] = deque(maxlen=MAX_UNDO)
        self._authors: deque[tuple[int, str]] = deque(maxlen=MAX_UNDO)

    @property
    def can_undo(self) -> bool:
        """True if there is a change to undo."""
        return bool(self._undo)

    def add(
        self,
        change: Change,
        position_mm: FloatArray,
        image: int | None = None,
        pixel: Pixel | None = None,
    ) -> ContourPoint:
        """Add a point at ``position_mm`` (3,); ``image`` and ``pixel``: where it was clicked."""
        point = ContourPoint(
            self._number + 1, np.array(position_mm), image, pixel, self.revision + 1
        )
        self._use(change, self.contour.added(point))
        self._number += 1
        return point

    def move(
        self, change: Change, number: int, position_mm: FloatArray, pixel: Pixel | None
    ) -> None:
        """Move a point, within its image."""
        point = self.contour.point(number)
        if point is None:
            raise InputError(
                f"contour: point {number} does not exist, it was erased meanwhile; expected a "
                "point that is shown"
            )
        if point.changed > change.seen and self._author(point.changed) != change.author:
            raise self._conflict()
        self._use(
            change,
            self.contour.moved(
                ContourPoint(number, np.array(position_mm), point.image, pixel, self.revision + 1)
            ),
        )

    def erase(self, change: Change, centre_mm: FloatArray, radius_mm: float) -> int:
        """Erase the points within ``radius_mm`` of ``centre_mm``; return their number."""
        self.require_seen(change)
        left = self.contour.erased(np.asarray(centre_mm), radius_mm)
        erased = len(self.contour.points) - len(left.points)
        if erased:
            self._use(change, left)
        return erased

    def delete_all(self, change: Change) -> None:
        """Remove all points; `undo` restores them."""
        self.require_seen(change)
        if self.contour.points:
            self._use(change, replace(self.contour, points=()))

    def dilate(self, change: Change, dilation_mm: float) -> None:
        """Set by how much the surface is dilated."""
        self.require_seen(change)
        self._use(change, replace(self.contour, dilation_mm=dilation_mm))

    def mark_hydromark(self, change: Change, radius_mm: float) -> None:
        """Let the points mark a hydromark of this radius; 0: they are on the tumour's surface."""
        self.require_seen(change)
        self._use(change, replace(self.contour, hydromark_mm=radius_mm))

    def calibrate(self, change: Change, calibration_mm: float) -> None:
        """Set the standard deviation of a point by the calibration of probe or tip."""
        self.require_seen(change)
        self._use(change, replace(self.contour, calibration_mm=calibration_mm))

    def undo(self, change: Change) -> None:
        """Restore the contour before the last change."""
        self.require_seen(change)
        if not self._undo:
            raise InputError("contour: there is no change to undo; expected one")
        self._use(change, self._undo.pop(), undoable=False)

    def require_seen(self, change: Change) -> None:
        """Raise `InputError` if another author has changed the contour since it was seen."""
        later = [author for revision, author in self._authors if revision > change.seen]
        # Authors of changes long ago are not known any more.
        if len(later) < self.revision - change.seen or set(later) - {change.author}:
            raise self._conflict()

    def _conflict(self) -> InputError:
        return InputError(
            "contour: another page has changed it meanwhile, and nothing was done here; expected "
            "the same request again, after a look at it"
        )

    def _author(self, revision: int) -> str | None:
        return next((author for known, author in self._authors if known == revision), None)

    def _use(self, change: Change, contour: Contour, *, undoable: bool = True) -> None:
        if undoable:
            self._undo.append(self.contour)
        self.contour = contour
        self.revision += 1
        self._authors.append((self.revision, change.author))
