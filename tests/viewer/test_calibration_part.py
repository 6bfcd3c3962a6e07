"""The calibration on the page: from recorded poses to the session's tip, by the page's commands."""

import numpy as np
import pytest

from app.viewer.messages.checks import NotDoneError, RefusedError
from tests.runtime.test_operator_commands import CONTENT, World
from tests.viewer.guided_part import GuidedPage, connect, must_not_be_used, requested
from tests.viewer.guided_part import operator as operator
from tests.workflow.guided import pivot_rotation
from tests.workflow.test_stylus_calibration import CONTENT as STYLUS_CONTENT
from tests.workflow.test_stylus_calibration import TIP_MM as STYLUS_TIP_MM
from tests.workflow.test_stylus_calibration import GuidedStylus
from tests.workflow.test_tool_calibration import TIP_MM, GuidedTool

pytestmark = pytest.mark.slow


def calibrating(request, guided=None):
    """A calibration on the page and the source of its poses."""
    guided = guided or GuidedTool(CONTENT)
    part = GuidedPage("calibration", guided.content, request)
    guided.guide = part.guide
    return guided, part


@pytest.fixture
def world():
    return World()


def test_pivot_becomes_the_tip_of_the_session_and_a_hold(world, operator):
    guided, part = calibrating(operator.request)
    assert part.part.values()["calibration_map"] is None
    part.run("start", "pivot", "cautery")
    for number in range(200):
        guided.observe(pivot_rotation(number))
    part.finish()
    assert part.values["verdict"].startswith("Good enough: sigma of the tip is")
    assert not part.values["can_use"]
    drawn = part.part.values()["calibration_map"]
    assert len(drawn["points"]) <= 120
    assert part.values["coverage"].startswith("8 of 8 directions, ")
    assert part.part.values()["calibration_map"] is drawn
    part.run("stop")
    part.finish()
    with pytest.raises(NotDoneError, match="the session is not ready for another one"):
        part.run("use")
    connect(operator, world)
    part.run("use")
    request = requested(world)
    tip = world.commands.content.tool_from_tip
    assert np.linalg.norm(tip.translation_mm - TIP_MM) < 0.5
    assert world.session.setup.tip_sigma_mm > 0.0
    assert "calibration of the tool replaced" in world.session.hold_causes[0]
    part.workflow.update(world.commands.content)
    assert (part.values["phase"], part.values["can_undo"]) == ("idle", True)
    assert (request.kind, request.accepted, request.origin) == ("set_tip", True, "the page")


def test_page_without_poses_says_why():
    guided, part = calibrating(must_not_be_used)
    assert part.values["title"] == part.values["verdict"] == ""
    part.run("start", "pivot", "cautery")
    guided.observe(pivot_rotation(0), lost=True)
    assert part.values["problem"] == (
        "No pose is recorded: 'cautery' in 'reference' is not known now"
    )
    assert part.values["count"] == "0 poses"
    guided.observe(pivot_rotation(0))
    assert (part.values["problem"], part.values["count"]) == ("", "1 pose")
    part.run("discard")
    assert part.values["phase"] == "idle"


def test_pivot_of_the_stylus_becomes_its_tip_without_a_hold(operator):
    world = World(items=STYLUS_CONTENT.items)
    setup = world.setup
    connect(operator, world)
    guided, part = calibrating(operator.request, GuidedStylus())
    part.run("start", "pivot", "stylus")
    assert part.values["title"] == "pivot of the stylus: recording"
    for number in range(200):
        guided.observe(pivot_rotation(number))
    part.run("stop")
    part.finish()
    part.run("use")
    request = requested(world).line
    content = world.commands.content
    assert np.linalg.norm(content.item("stylus").tip.translation_mm - STYLUS_TIP_MM) < 0.3
    assert content.tool_from_tip is world.content.tool_from_tip
    assert world.session.setup is setup
    assert world.session.hold_causes == ()
    assert not any(event.startswith(("revoke", "latch")) for event in world.output_events)
    assert request.startswith("set_stylus_tip from the page accepted: the first tip, sigma 0.")


def test_viewers_outdated_pages_and_wrong_tools_change_nothing():
    _, part = calibrating(must_not_be_used)
    part.check_viewers_and_outdated_pages_are_refused(
        {"start": ["pivot", "stylus"], "stop": [], "discard": [], "use": [], "undo": []}
    )
    with pytest.raises(RefusedError, match="expected one of pivot, spin"):
        part.run("start", "turn", "cautery")
    with pytest.raises(RefusedError, match="expected one of cautery, stylus"):
        part.run("start", "pivot", "needle")
    with pytest.raises(NotDoneError, match="stylus: the session has none; expected 'stylus' in"):
        part.run("start", "pivot", "stylus")
    assert part.values["revision"] == 0
