"""Commands of the page that edit the contour. Each names the page, and the revision it has seen."""

from collections.abc import Callable

import numpy as np

from app.contour import MAX_DILATION_MM, MAX_RADIUS_MM, Change
from app.geometry import FloatArray, InputError
from app.runtime import TrackedTool
from app.viewer.contour_part import ContourPart
from app.viewer.messages.checks import integer, number, one_of, text
from app.viewer.messages.commands import Commands

MAX_ERASE_MM = 30.0
MAX_CALIBRATION_MM = 5.0
_MAX_PIXEL = 10_000.0
_MAX_NUMBER = 2**53 - 1
_author = text(16)
_seen = integer(0, _MAX_NUMBER)
_pixel = number(-_MAX_PIXEL, _MAX_PIXEL)


class ContourControls:
    """Add, move and erase points, undo, delete all, dilate, mark a clip, state the error, accept.

    A change that cannot be made, also because another page has changed the contour, raises
    `InputError`: the page that asked shows its text, and the contour stays as it is.
    """

    def __init__(
        self, commands: Commands, part: ContourPart, changed: Callable[[], None], *, live: bool
    ) -> None:
        self._part = part
        self._changed = changed
        image = integer(0, _MAX_NUMBER)
        commands.add("contour_add", self._add, _author, image, _pixel, _pixel)
        tool = one_of([each.value for each in TrackedTool])
        commands.add("contour_tip", self._tip, _author, tool)
        commands.add("contour_move", self._move, _author, _seen, image, _pixel, _pixel)
        radius = number(0.0, MAX_ERASE_MM)
        commands.add("contour_erase", self._erase, _author, _seen, image, _pixel, _pixel, radius)
        commands.add("contour_undo", self._undo, _author, _seen)
        commands.add("contour_delete_all", self._delete_all, _author, _seen)
        dilation = number(0.0, MAX_DILATION_MM)
        commands.add("contour_dilation", self._dilate, _author, _seen, dilation)
        error = number(0.0, MAX_CALIBRATION_MM)
        radius = number(0.0, MAX_RADIUS_MM)
        commands.add("contour_hydromark", self._mark, _author, _seen, radius)
        commands.add("contour_calibration", self._calibrate, _author, _seen, error)
        if live:
            commands.add("contour_accept", self._accept, _author, _seen)

    def _add(self, author: str, image: int, x: float, y: float) -> None:
        place = self._place(image, x, y)
        editor = self._part.editor
        self._do(lambda: editor.add(Change(author, editor.revision), place, image, (x, y)))

    def _tip(self, author: str, tool: str) -> None:
        def add() -> None:
            place = self._part.places.tip_mm(TrackedTool(tool))
            editor.add(Change(author, editor.revision), place)

        editor = self._part.editor
        self._do(add)

    def _move(self, author: str, seen: int, point: int, x: float, y: float) -> None:
        editor = self._part.editor
        known = editor.contour.point(point)
        if known is not None and known.image is None:
            raise InputError("contour: a point at the tip cannot be moved; expected to erase it")
        # A point that is gone is refused by the editor.
        place = np.zeros(3) if known is None else self._place(known.image or 0, x, y)
        self._do(lambda: editor.move(Change(author, seen), point, place, (x, y)))

    def _erase(self, author: str, seen: int, image: int, x: float, y: float, radius: float) -> None:
        place = self._place(image, x, y)
        self._do(lambda: self._part.editor.erase(Change(author, seen), place, radius))

    def _undo(self, author: str, seen: int) -> None:
        self._do(lambda: self._part.editor.undo(Change(author, seen)))

    def _delete_all(self, author: str, seen: int) -> None:
        self._do(lambda: self._part.editor.delete_all(Change(author, seen)))

    def _dilate(self, author: str, seen: int, dilation_mm: float) -> None:
        self._do(lambda: self._part.editor.dilate(Change(author, seen), dilation_mm))

    def _mark(self, author: str, seen: int, radius_mm: float) -> None:
        self._do(lambda: self._part.editor.mark_hydromark(Change(author, seen), radius_mm))

    def _calibrate(self, author: str, seen: int, error_mm: float) -> None:
        self._do(lambda: self._part.editor.calibrate(Change(author, seen), error_mm))

    def _accept(self, author: str, seen: int) -> None:
        def accept() -> None:
            self._part.editor.require_seen(Change(author, seen))
            self._part.accept()

        self._do(accept)

    def _place(self, image: int, x: float, y: float) -> FloatArray:
        """The place (3,) in mm of a pixel. Raises `InputError` for an image without one."""
        matrix = self._part.places.matrix(image)
        if matrix is None:
            raise InputError(
                f"contour: the place of image {image} is not known; expected an image that was "
                "shown"
            )
        return np.asarray((matrix @ (x, y, 0.0, 1.0))[:3])

    def _do(self, change: Callable[[], object]) -> None:
        change()
        self._changed()
