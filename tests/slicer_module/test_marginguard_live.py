"""Live session of the module in this process, with a tracker in another one."""

import re
import signal
import threading
from contextlib import suppress
from queue import Queue

import pytest
from std_msgs.msg import String

from app.bridge import RosNode
from app.bridge.topics import EXECUTED_PLAN
from app.fixture import MarginState
from app.geometry import MarginGuardError
from tests.bridge.conftest import StartReceiver as StartReceiver
from tests.bridge.conftest import structures_yaml as structures_yaml
from tests.bridge.displays.conftest import forked_nodes as forked_nodes
from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.bridge.live.test_live_command import SENDER, TRACKED
from tests.ros_domain import domain_id as domain_id
from tests.slicer_module.marginguard_module import CASE, node_of, spin_until, tumor_color
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


@pytest.fixture
def panel_logic(unconnected, domain_id, forked_nodes):
    return unconnected


def is_rearmed(panel_logic, status):
    """True without a hold; else re-arm, again after a refusal, as when a pose comes late."""
    if status.state is not MarginState.UNKNOWN and "latched" not in status.reasons:
        return True
    if not panel_logic.session.requests.current:
        with suppress(MarginGuardError):
            panel_logic.rearm()
    return False


def from_panel(kind, outcome):
    """Whether a line of the list of requests is that of the panel's node."""
    return re.compile(rf"{kind} from the panel \(/marginguard_panel_\w+\) {outcome}").match


def test_killed_tracker_makes_margin_unknown_and_latches_hold_until_rearm(
    panel_logic, application, start, frames_file, live_yaml
):
    config = live_yaml(TRACKED)
    with config.open("a") as file:
        file.write("needle: {frame: needle, length_mm: 60}\n")
    panel_logic.connect(config)
    assert panel_logic.refresh().session == "connecting ..."
    with pytest.raises(MarginGuardError, match="no case is loaded"):
        panel_logic.pause()
    with pytest.raises(
        MarginGuardError, match="a live session is running; expected none: disconnect first"
    ):
        panel_logic.load_case(CASE)
    sender = start(str(SENDER), str(frames_file), "tracked", "again")
    status = spin_until(
        panel_logic,
        lambda now: now.state is MarginState.POSITIVE and panel_logic.events.breaches.is_inside,
    )
    assert status.is_live
    assert tumor_color(application) == MarginState.POSITIVE.color
    assert "CauteryToTracker: valid" in status.trackers
    assert "tip" in panel_logic.events.breach_rows()[-1][3]
    panel_logic.events.add_note("first cut")
    accepted = from_panel("note", r"accepted: first cut \(step ")
    status = spin_until(panel_logic, lambda now: accepted(now.request))
    with pytest.raises(MarginGuardError, match="no case is loaded"):
        panel_logic.events.go_to_note(0)

    assert status.items[0].text == "60"
    panel_logic.items.lengthen("needle", -5.0)
    accepted = from_panel("needle_length", "accepted: from 60 to 55 mm")
    status = spin_until(panel_logic, lambda now: accepted(now.request))
    assert status.items[0].text == "55"
    assert node_of(application, "NeedleModel") is not None
    panel_logic.set_margins(9.0, 5.0)
    refused = "set_margins: warn_mm is 5; expected more than stop_mm 9"
    spin_until(panel_logic, lambda now: now.message.startswith(refused))
    panel_logic.set_margins(1.5, 6.0)
    spin_until(panel_logic, lambda now: panel_logic.margins().stop_mm == 1.5)
    assert panel_logic.margins().warn_mm == 6.0

    answers = Queue()
    panel_logic.plans._ask({"waist": 0.0}, 5.0, lambda *answer: answers.put(answer))
    plan, problem = answers.get(timeout=DEADLINE_S)
    assert plan == ""
    assert "/marginguard_plan/plan" in problem  # no planner runs

    with RosNode("executor") as executor:
        plans = executor.publisher(EXECUTED_PLAN)
        plans.publish(String(data="{}"))
        status = spin_until(panel_logic, lambda now: now.plans.approach)
        assert status.plans.approach.problem.startswith("plan: is not a plan (KeyError: 'times_ns'")
    spin_until(panel_logic, lambda now: now.plans.approach is None)

    sender.end(signal.SIGKILL)
    spin_until(panel_logic, lambda now: now.state is MarginState.UNKNOWN and "stale" in now.reasons)
    assert tumor_color(application) == MarginState.UNKNOWN.color
    with pytest.raises(MarginGuardError, match="UNKNOWN"):
        panel_logic.rearm()

    start(str(SENDER), str(frames_file), "tracked", "again")
    status = spin_until(
        panel_logic, lambda now: now.state is not MarginState.UNKNOWN and "latched" in now.reasons
    )
    spin_until(panel_logic, lambda now: is_rearmed(panel_logic, now))

    with RosNode("executor") as executor:
        executor.publisher(EXECUTED_PLAN).publish(String(data="{}"))
        spin_until(panel_logic, lambda now: now.plans.approach)
        panel_logic.disconnect()
        status = spin_until(panel_logic, lambda now: not now.has_session)
        status = spin_until(panel_logic, lambda now: now.state is MarginState.UNKNOWN)
        assert status.session == "live session has ended"
        assert status.plans.approach is None
    assert tumor_color(application) == MarginState.UNKNOWN.color


def test_structure_is_switched_off_and_on(panel_logic, structures_yaml):
    panel_logic.connect(structures_yaml)
    guarded = (("lesion_2", True), ("chest_wall", True))
    spin_until(panel_logic, lambda now: now.structures == guarded)
    panel_logic.switch_structure("chest_wall", False, " ")
    spin_until(panel_logic, lambda now: "reason" in now.message)
    panel_logic.switch_structure("chest_wall", False, "not in the field")
    status = spin_until(panel_logic, lambda now: now.structures[1:] == (("chest_wall", False),))
    assert "chest wall: OFF, not in the field" in status.reasons
    panel_logic.switch_structure("chest_wall", True, "")
    spin_until(panel_logic, lambda now: now.structures == guarded)


def test_missing_configuration_is_reported_in_one_line(panel_logic, tmp_path):
    panel_logic.connect(tmp_path / "live.yaml")
    status = spin_until(panel_logic, lambda now: now.message)
    assert status.message == f"{tmp_path / 'live.yaml'} is not a live configuration: no such file"
    with pytest.raises(MarginGuardError, match="there is no session; expected one"):
        panel_logic.set_margins(1.0, 5.0)


class WaitingRun:
    """TEST DOUBLE: a live run without samples."""

    operator = workflow = images = None
    delay_ns, silence = 0, ""

    def __init__(self, config, workflow_of):
        self._stopped = threading.Event()

    def steps(self):
        self._stopped.wait()
        yield from ()

    def stop(self):
        self._stopped.set()


def test_case_that_is_still_being_opened_does_not_end_live_session(panel_logic, monkeypatch):
    go_on, opened = threading.Event(), threading.Event()

    def open_slowly(folder):
        go_on.wait()
        opened.set()

    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", open_slowly)
    monkeypatch.setattr("MarginGuardLib.logic.LiveStepRun", WaitingRun)
    panel_logic.load_case(CASE)
    assert panel_logic.refresh().message == "opening the case ..."
    panel_logic.connect(CASE)
    go_on.set()
    opened.wait()
    for _ in range(5):
        status = panel_logic.refresh()
        assert status.is_live
        assert status.message == ""
