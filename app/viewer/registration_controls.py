"""Commands of the page that register the robot."""

from collections.abc import Callable

from app.runtime import TrackedTool
from app.viewer.guided_controls import GuidedControls, seen_revision
from app.viewer.messages.checks import one_of, text
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import RefusedError
from app.viewer.registration_part import RegistrationPart

_MAX_DIGITS = 20


class RegistrationControls(GuidedControls[RegistrationPart]):
    """Start, remove and restore a point, and the commands of `GuidedControls`."""

    def __init__(
        self, commands: Commands, part: RegistrationPart, changed: Callable[[], None]
    ) -> None:
        super().__init__("registration", commands, part, changed)
        tool = one_of([each.value for each in TrackedTool])
        commands.add("registration_start", self._start, seen_revision, tool)
        commands.add("registration_remove", self._remove, seen_revision, text(_MAX_DIGITS))
        commands.add("registration_restore", self._restore, seen_revision)

    def _start(self, seen: int, tool: str) -> None:
        self._do(lambda: self._part.guide.start(seen, TrackedTool(tool)))

    def _remove(self, seen: int, point: str) -> None:
        if not (point.isascii() and point.isdecimal()):
            raise RefusedError("point: not one of the registration; expected its decimal number")
        self._do(lambda: self._part.guide.remove(seen, int(point)))

    def _restore(self, seen: int) -> None:
        self._do(lambda: self._part.guide.restore(seen))
