"""Commands of the page that register the robot. Each names the revision that the page has seen."""

from collections.abc import Callable

from app.geometry import InputError
from app.viewer.messages.checks import integer, text
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError, RefusedError
from app.viewer.registration_part import RegistrationPart

_seen = integer(0, 2**53 - 1)
_MAX_DIGITS = 20


class RegistrationControls:
    """Start, stop, discard, remove and restore a point, use the registration, undo.

    A command that cannot be done, also because another page has changed the registration, raises
    `NotDoneError`: the page that asked shows its text, and nothing has changed.
    """

    def __init__(
        self, commands: Commands, part: RegistrationPart, changed: Callable[[], None]
    ) -> None:
        self._part = part
        self._changed = changed
        commands.add("registration_start", self._start, _seen)
        commands.add("registration_stop", self._stop, _seen)
        commands.add("registration_discard", self._discard, _seen)
        commands.add("registration_remove", self._remove, _seen, text(_MAX_DIGITS))
        commands.add("registration_restore", self._restore, _seen)
        commands.add("registration_use", self._use, _seen)
        commands.add("registration_undo", self._undo, _seen)

    def _start(self, seen: int) -> None:
        self._do(lambda: self._part.guide.start(seen))

    def _stop(self, seen: int) -> None:
        self._do(lambda: self._part.guide.stop(seen))

    def _discard(self, seen: int) -> None:
        self._do(lambda: self._part.guide.discard(seen))

    def _remove(self, seen: int, point: str) -> None:
        if not (point.isascii() and point.isdecimal()):
            raise RefusedError("point: not one of the registration; expected its decimal number")
        self._do(lambda: self._part.guide.remove(seen, int(point)))

    def _restore(self, seen: int) -> None:
        self._do(lambda: self._part.guide.restore(seen))

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
