"""Processes beside a playback of the recorded case."""

import pytest


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
