"""Processes beside a playback of the recorded case."""

import pytest

from tests.bridge.conftest import start_receiver as start_receiver
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id


@pytest.fixture
def tracker(start, project_root):
    """``tracker("--start", "90")`` starts to play the recorded case."""

    def start_tracker(*options):
        case = str(project_root / "data" / "recorded_case")
        return start("-m", "app.cli", "tracker", case, *options)

    return start_tracker


@pytest.fixture
def playing(tracker):
    """``playing()`` starts to play the recorded case and waits for the first sample."""

    def start_playing(*options):
        child = tracker(*options)
        child.line(lambda line: line.startswith("PLAYBACK of"))
        return child

    return start_playing
