"""The calibration on the page: from recorded poses to the session's tip, by the page's commands."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from app.runtime import RequestLog, TipChange, compute_here
from app.viewer import LiveOperator
from app.viewer.access.role import Role
from app.viewer.calibration_controls import CalibrationControls
from app.viewer.calibration_part import CalibrationPart
from app.viewer.messages.commands import Commands
from app.viewer.messages.errors import NotDoneError, RefusedError
from tests.runtime.test_operator_commands import CONTENT, TOOL_EDGE, World
from tests.runtime.workflow.test_stylus_calibration import CONTENT as STYLUS_CONTENT
from tests.runtime.workflow.test_stylus_calibration import TIP_MM as STYLUS_TIP_MM
from tests.runtime.workflow.test_stylus_calibration import Guided as StylusGuided
from tests.runtime.workflow.test_stylus_calibration import pivot
from tests.runtime.workflow.test_tool_calibration import TIP_MM, Guided, pivot_rotation


class Calibrating:
    """A calibration part with its commands, and the waiting for its fits."""

    def __init__(self, use, guided=None):
        self.computed = threading.Semaphore(0)
        self.guided = guided or Guided(CONTENT)
        self.part = CalibrationPart(self.guided.guide, compute_here, self.computed.release, use)
        self.commands = Commands()
        CalibrationControls(self.commands, self.part, lambda: None)

    @property
    def values(self):
        return self.part.values()["calibration"]

    def run(self, name, *args, role=Role.OPERATE):
        self.commands.run(f"calibration_{name}", [self.values["revision"], *args], role)

    def finish(self):
        """Wait until the present poses are fitted."""
        self.part.update(self.guided.content)
        for _ in range(3):
            if self.guided.guide.task() is None:
                return
            assert self.computed.acquire(timeout=60.0)
            self.part.update(self.guided.content)
        raise AssertionError("not computed")


@pytest.fixture
def world():
    return World()


def test_pivot_becomes_the_tip_of_the_session_and_a_hold(world):
    with ThreadPoolExecutor(2) as workers:
        operator = LiveOperator(workers)
        calibrating = Calibrating(operator.set_tip)
        assert calibrating.part.values()["calibration_map"] is None
        calibrating.run("start", "pivot", "cautery")
        for number in range(200):
            calibrating.guided.observe(pivot_rotation(number))
        calibrating.finish()
        assert calibrating.values["verdict"].startswith("Good enough: sigma of the tip is")
        assert not calibrating.values["ready"]
        drawn = calibrating.part.values()["calibration_map"]
        assert len(drawn["points"]) <= 120
        assert drawn["text"].startswith("8 of 8 directions, ")
        assert calibrating.part.values()["calibration_map"] is drawn
        calibrating.run("stop")
        calibrating.finish()
        with pytest.raises(NotDoneError, match="the session is not ready for another one"):
            calibrating.run("use")
        operator.connect(world.commands)
        calibrating.run("use")
    tip = world.commands.content.tool_from_tip
    assert np.linalg.norm(tip.translation_mm - TIP_MM) < 0.5
    assert world.session.setup.tip_sigma_mm > 0.0
    assert "calibration of the tool replaced" in world.session.hold_causes[0]
    calibrating.part.update(world.commands.content)
    assert (calibrating.values["phase"], calibrating.values["undo"]) == ("idle", True)
    request = world.commands.requests.last
    assert (request.kind, request.accepted, request.origin) == ("set_tip", True, "the page")


def test_page_without_poses_says_why():
    calibrating = Calibrating(lambda change: pytest.fail("must not be used"))
    assert calibrating.values["title"] == calibrating.values["verdict"] == ""
    calibrating.run("start", "pivot", "cautery")
    calibrating.guided.observe(pivot_rotation(0), lost=True)
    assert calibrating.values["problem"] == "'cautery' in 'reference' is not known now"
    assert calibrating.values["count"] == "0 poses"
    calibrating.guided.observe(pivot_rotation(0))
    assert (calibrating.values["problem"], calibrating.values["count"]) == ("", "1 pose")
    calibrating.run("discard")
    assert calibrating.values["phase"] == "idle"


def test_pivot_of_the_stylus_becomes_its_tip_without_a_hold():
    world = World(content=STYLUS_CONTENT)
    setup = world.setup
    with ThreadPoolExecutor(2) as workers:
        operator = LiveOperator(workers)
        operator.connect(world.commands)
        calibrating = Calibrating(operator.set_tip, StylusGuided(STYLUS_CONTENT))
        calibrating.run("start", "pivot", "stylus")
        assert calibrating.values["title"] == "pivot of the stylus: recording"
        for number in range(200):
            calibrating.guided.observe(pivot(number))
        calibrating.run("stop")
        calibrating.finish()
        calibrating.run("use")
    content = world.commands.content
    assert np.linalg.norm(content.stylus.tip.translation_mm - STYLUS_TIP_MM) < 0.3
    assert content.tool_from_tip is STYLUS_CONTENT.tool_from_tip
    assert world.session.setup is setup
    assert world.session.hold_causes == ()
    assert not any(event.startswith(("revoke", "latch")) for event in world.output_events)
    request = world.commands.requests.last.line
    assert request.startswith("set_stylus_tip from the page accepted: the first tip, sigma 0.")


def test_viewers_and_outdated_pages_change_nothing():
    calibrating = Calibrating(lambda change: pytest.fail("must not be used"))
    for name in ("start", "stop", "discard", "use", "undo"):
        args = ["pivot", "stylus"] if name == "start" else []
        with pytest.raises(RefusedError, match="role view; expected operate"):
            calibrating.run(name, *args, role=Role.VIEW)
        with pytest.raises(NotDoneError, match="another page has changed it meanwhile"):
            calibrating.commands.run(f"calibration_{name}", [77, *args], Role.OPERATE)
    with pytest.raises(RefusedError, match="expected one of pivot, spin"):
        calibrating.run("start", "turn", "cautery")
    with pytest.raises(RefusedError, match="expected one of cautery, stylus"):
        calibrating.run("start", "pivot", "needle")
    with pytest.raises(NotDoneError, match="stylus: the session has none; expected 'stylus' in"):
        calibrating.run("start", "pivot", "stylus")
    assert calibrating.values["revision"] == 0


def test_second_tip_waits_for_the_first():
    entered, leave = threading.Event(), threading.Event()

    class Slow:
        """Test double of a session's commands: a tip waits for ``leave``."""

        requests = RequestLog(lambda: 0, lambda: 0)

        @staticmethod
        def set_tip(tool_from_tip, *, sigma_mm, origin):
            entered.set()
            assert leave.wait(60.0)

    with ThreadPoolExecutor(2) as workers:
        operator = LiveOperator(workers)
        operator.connect(Slow())
        change = TipChange(TOOL_EDGE, 0.1)
        assert operator.set_tip(change)
        assert entered.wait(60.0)
        assert not operator.set_tip(change)
        leave.set()
