"""Commands of the page that calibrate a tool."""

from collections.abc import Callable

from app.runtime import CalibrationKind, TrackedTool
from app.viewer.calibration_part import CalibrationPart
from app.viewer.guided_controls import GuidedControls, seen_revision
from app.viewer.messages.checks import one_of
from app.viewer.messages.commands import Commands


class CalibrationControls(GuidedControls[CalibrationPart]):
    """Start, and the commands of `GuidedControls`."""

    def __init__(
        self, commands: Commands, part: CalibrationPart, changed: Callable[[], None]
    ) -> None:
        super().__init__("calibration", commands, part, changed)
        kind = one_of([each.value for each in CalibrationKind])
        tool = one_of([each.value for each in TrackedTool])
        commands.add("calibration_start", self._start, seen_revision, kind, tool)

    def _start(self, seen: int, kind: str, tool: str) -> None:
        self._do(lambda: self._part.guide.start(seen, CalibrationKind(kind), TrackedTool(tool)))
