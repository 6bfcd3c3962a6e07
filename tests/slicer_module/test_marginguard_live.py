"""The module's live session in this process, with a tracker in another one."""

import signal
import threading

import pytest

from app.fixture import MarginState
from app.geometry import MarginGuardError
from tests.bridge.conftest import StartReceiver as StartReceiver
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.bridge.live.test_live_command import SENDER, TRACKED
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import CASE, spin_until
from tests.slicer_module.marginguard_module import application as application

from MarginGuardLib.logic import PanelLogic  # isort: skip


@pytest.fixture
def guard(application, domain_id):
    logic = PanelLogic(application.scene)
    yield logic
    logic.close()


def tumor_color(application):
    return application.scene.GetFirstNodeByName("Tumor").GetDisplayNode().GetColor()


def is_rearmed(guard):
    """Refused where the machine paused, and with it the tracker, after what is shown."""
    try:
        guard.rearm()
    except MarginGuardError:
        return False
    return True


def test_a_tracker_that_dies_turns_the_tumour_grey_until_somebody_rearms(
    guard, application, start, frames_file, live_yaml
):
    guard.connect(live_yaml(TRACKED))
    assert guard.spin().session == "connecting ..."
    with pytest.raises(MarginGuardError, match="no case is loaded"):
        guard.pause()
    with pytest.raises(MarginGuardError, match="a live session is running: disconnect first"):
        guard.load_case(CASE)
    sender = start(str(SENDER), str(frames_file), "tracked", "again")
    status = spin_until(guard, lambda now: now.state is MarginState.POSITIVE)
    assert status.is_live
    assert tumor_color(application) == MarginState.POSITIVE.color
    assert "CauteryToTracker: valid" in status.trackers

    with pytest.raises(MarginGuardError, match="warn_mm is 5; expected more than stop_mm 9"):
        guard.set_margins(9.0, 5.0)
    guard.set_margins(1.5, 6.0)
    assert (guard.margins().stop_mm, guard.margins().warn_mm) == (1.5, 6.0)

    sender.end(signal.SIGKILL)
    status = spin_until(guard, lambda now: now.state is MarginState.UNKNOWN)
    assert tumor_color(application) == MarginState.UNKNOWN.color
    assert "stale" in status.reasons
    with pytest.raises(MarginGuardError, match="UNKNOWN"):
        guard.rearm()

    start(str(SENDER), str(frames_file), "tracked", "again")
    status = spin_until(
        guard, lambda now: now.state is not MarginState.UNKNOWN and "latched" in now.reasons
    )
    spin_until(guard, lambda now: is_rearmed(guard))
    spin_until(
        guard, lambda now: now.state is not MarginState.UNKNOWN and "latched" not in now.reasons
    )

    guard.disconnect()
    status = spin_until(guard, lambda now: not now.has_session)
    status = spin_until(guard, lambda now: now.state is MarginState.UNKNOWN)
    assert status.session == "live session has ended"
    assert tumor_color(application) == MarginState.UNKNOWN.color


def test_a_configuration_that_is_wrong_is_one_line(guard, tmp_path):
    guard.connect(tmp_path / "live.yaml")
    status = spin_until(guard, lambda now: now.message)
    assert status.message == f"{tmp_path / 'live.yaml'} is no live configuration: no such file"
    with pytest.raises(MarginGuardError, match="there is no session"):
        guard.set_margins(1.0, 5.0)


class WaitingRun:
    """TEST DOUBLE: a live session whose tracker says nothing."""

    commands = None

    def __init__(self, config):
        self._halted = threading.Event()

    def steps(self):
        self._halted.wait()
        yield from ()

    def stop(self):
        self._halted.set()


def test_a_case_that_is_still_being_opened_does_not_end_a_live_session(guard, monkeypatch):
    go_on, opened = threading.Event(), threading.Event()

    def open_slowly(folder):
        go_on.wait()
        opened.set()

    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", open_slowly)
    monkeypatch.setattr("MarginGuardLib.logic.LiveOpening", WaitingRun)
    guard.load_case(CASE)
    assert guard.spin().message == "opening the case ..."
    guard.connect(CASE)
    go_on.set()
    opened.wait()
    for _ in range(5):
        status = guard.spin()
        assert status.is_live
        assert status.message == ""
