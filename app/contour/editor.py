"""Editing of one contour by several pages: each change has an author, and undo restores all."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from app.contour.points import Contour, ContourPoint, Pixel
from app.geometry import FloatArray, InputError

MAX_UNDO = 200


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
