"""Commands of the page that calibrate the tool. Each names the revision that the page has seen."""

from collections.abc import Callable

from app.geometry import InputError
from app.runtime import CalibrationKind
from app.viewer.calibration_part import CalibrationPart
from app.viewer.messages.checks import integer, one_of
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError

_seen = integer(0, 2**53 - 1)


class CalibrationControls:
    """Start, stop, discard, use the tip, undo.

    A command that cannot be done, also because another page has changed the calibration, raises
    `NotDoneError`: the page that asked shows its text, and nothing has changed.
    """

    def __init__(
        self, commands: Commands, part: CalibrationPart, changed: Callable[[], None]
    ) -> None:
        self._part = part
        self._changed = changed
        kind = one_of([each.value for each in CalibrationKind])
        commands.add("calibration_start", self._start, _seen, kind)
        commands.add("calibration_stop", self._stop, _seen)
        commands.add("calibration_discard", self._discard, _seen)
        commands.add("calibration_use", self._use, _seen)
        commands.add("calibration_undo", self._undo, _seen)

    def _start(self, seen: int, kind: str) -> None:
        self._do(lambda: self._part.guide.start(seen, CalibrationKind(kind)))

    def _stop(self, seen: int) -> None:
        self._do(lambda: self._part.guide.stop(seen))

    def _discard(self, seen: int) -> None:
        self._do(lambda: self._part.guide.discard(seen))

    def _use(self, seen: int) -> None:
        self._do(lambda: self._part.guide.accept(seen, self._part.use))

    def _undo(self, seen: int) -> None:
        self._do(lambda: self._part.guide.undo(seen, self._part.use))

    def _do(self, change: Callable[[], None]) -> None:
        try:
            change()
        except InputError as error:
            raise NotDoneError(str(error)) from error
        self._changed()
