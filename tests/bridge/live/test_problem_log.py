"""Log of the problems with a tracker's frames: each kind once, also beside an earlier one."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from app.bridge.live.outputs import FramesProblemLog

pytestmark = pytest.mark.slow

UNCHECKED = "nothing checks the tracker: no joint positions"
REFUSED = (
    "PLAYBACK refused: poses from a recording, case 1 (seed 1; no patient); expected a live one"
)
MISNAMED = "tool.frame is 'cautary': not among what the tracker sends so far, cautery{}"
DRIFT = "drift: tip is {} mm from its pose; expected at most 5 mm; the tool is {} mm off"


@dataclass
class RecordingLogger:
    """Test double of a ROS logger."""

    lines: list[str] = field(default_factory=list)

    def warning(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture
def logged() -> Any:
    logger = RecordingLogger()
    log = FramesProblemLog(SimpleNamespace(node=SimpleNamespace(get_logger=lambda: logger)))

    def publish(*problems: str) -> list[str]:
        assert log.publish(SimpleNamespace(frames_problems=problems), None)
        return logger.lines

    return publish


def test_problem_that_joins_an_earlier_one_is_logged(logged):
    assert logged() == []
    assert logged(UNCHECKED) == [UNCHECKED]
    assert logged(UNCHECKED, REFUSED) == [UNCHECKED, REFUSED]
    assert logged(REFUSED) == [UNCHECKED, REFUSED]


def test_details_that_change_are_logged_once(logged):
    for value in range(5):
        lines = logged(UNCHECKED, DRIFT.format(value, value), MISNAMED.format(value * ", needle"))
    assert lines == [UNCHECKED, DRIFT.format(0, 0), MISNAMED.format("")]
