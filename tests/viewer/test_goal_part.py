"""A goal for the tool on the page: the ghost of the arm follows it, or the page says why not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.geometry import InputError, Transform
from app.registration import DriftBound, given_registration
from app.robot import load_robot
from app.session import RobotSetup
from app.viewer import SceneView
from app.viewer.drawing.grips import PicturePoints
from app.viewer.drawing.scene_view import Part
from app.viewer.plan_part import GoalDrag, PlanPart
from app.workflow import ApproachGhost, GoalPose, NeedleGuide
from tests.planning.plan_files import write_approach
from tests.tiers import PROJECT_ROOT
from tests.viewer.test_hand_part import event

pytestmark = pytest.mark.slow

ABOVE_MM = 60.0
"""The tip is so far above the middle of the tumour."""

STEP_MM, AWAY_MM = np.array([0.0, 10.0, 5.0]), np.array([2000.0, 0.0, 0.0])
WAY = np.array([0.01, 0.02])
"""Way of the pointer in the picture."""


@pytest.fixture(scope="module")
def robot():
    return load_robot(PROJECT_ROOT / "data" / "robots" / "touch" / "touch.urdf")


@pytest.fixture(scope="module")
def moment(parts, robot):
    """The first moment of the small case, with a robot whose joints are known."""
    state = dict.fromkeys(robot.actuated_joint_names, 0.0) | {"shoulder": 0.6, "elbow": 0.3}
    links = robot.forward_kinematics(state)
    content, shown = parts.content, parts.feed.shown[0]
    middle = content.frame_from_tumor.apply(content.tumor.vertices_mm).mean(axis=0)
    base_mm = middle - links["stylus"].translation_mm + [0.0, 0.0, ABOVE_MM]
    registration = given_registration(Transform("reference", "robot_base", np.eye(3), base_mm))
    setup = RobotSetup(robot, "robot_base", "stylus", registration, DriftBound(5.0, 0.1))
    reference = Transform.identity("needle", "reference")
    static = (*content.static_edges, reference, registration.transform)
    content = replace(content, robot=setup, static_edges=static)
    edges = shown.step.edges._replace(
        static=static,
        links=links,
        links_stamp=shown.step.frame.stamp,
        link_names=frozenset(links),
        base="robot_base",
        root=robot.root_link,
    )
    step = replace(shown.step, edges=edges, links=links)
    return replace(shown, content=content, step=step)


@pytest.fixture
def page(can_draw, moment):
    """The view with a goal; ``asked`` are the requests for a plan, ``cancelled`` their numbers."""
    asked, cancelled, ghost = [], [], ApproachGhost()

    def plan(*request):
        asked.append(request)
        number = len(asked)
        return lambda: cancelled.append(number)

    goal = GoalPose(plan, ghost.choose)
    view = SceneView(moment.content, added=(Part.GHOST,))
    view.view.render_window().SetSize(800, 600)
    part = PlanPart(ghost, NeedleGuide(), goal)

    def show(**changes):
        now = replace(moment, **changes)
        view.show(now)
        part.update(now, view)
        return part.values()["goal"]

    show()
    return SimpleNamespace(
        asked=asked, cancelled=cancelled, ghost=ghost, goal=goal, view=view, part=part, show=show
    )


def reached_mm(goal):
    return goal.links["stylus"].translation_mm


def test_goal_begins_at_the_tool_and_the_arm_follows_it(page, robot):
    assert page.show() == {
        "is_active": False, "place": "", "problem": "", "status": "", "can_plan": False,
    }  # fmt: skip
    page.goal.begin(5.0)
    begin = page.goal.place_mm
    assert page.show()["problem"] == ""
    assert set(page.view.added[Part.GHOST]) == {each.name for each in robot.links if each.visuals}
    turned = page.goal.links["stylus"].rotation
    page.goal.move_to(begin + STEP_MM)
    assert page.show()["problem"] == ""
    np.testing.assert_allclose(reached_mm(page.goal), begin + STEP_MM, atol=1e-4)
    np.testing.assert_allclose(page.goal.links["stylus"].rotation, turned, atol=1e-6)
    page.goal.turn(np.array([0.0, 0.0, 0.2]))
    turn = page.goal.links["stylus"].rotation @ turned.T
    assert np.arccos((np.trace(turn) - 1.0) / 2.0) == pytest.approx(0.2, abs=1e-6)
    page.goal.end()
    page.show()
    assert page.view.added[Part.GHOST] == {}


def test_page_says_why_the_arm_is_not_at_the_goal(page):
    page.goal.begin(5.0)
    begin = page.goal.place_mm
    page.goal.move_to(begin + AWAY_MM)
    values = page.show()
    assert values["problem"].startswith("out of reach: link 'stylus' cannot be moved to")
    assert values["can_plan"] is False
    np.testing.assert_allclose(reached_mm(page.goal), begin, atol=1e-4)
    with pytest.raises(InputError, match="goal: out of reach: "):
        page.goal.plan()
    page.goal.move_to(begin - [0.0, 0.0, ABOVE_MM])
    assert "collision: " in page.show()["problem"]
    assert " mm from tumor; expected at least 5 mm" in page.show()["problem"]
    page.goal.move_to(begin)
    assert page.show()["problem"] == ""


def test_plan_to_the_goal_is_asked_for_and_shown(page, moment, robot, tmp_path):
    page.goal.begin(5.0)
    page.goal.move_to(page.goal.place_mm + STEP_MM)
    goal_mm = page.goal.place_mm
    page.goal.plan()
    ((joints, clearance_mm, answer),) = page.asked
    reached = robot.forward_kinematics(joints)["stylus"].translation_mm
    np.testing.assert_allclose(reached, goal_mm, atol=1e-4)
    assert (clearance_mm, page.show()["status"]) == (5.0, "planning...")
    with pytest.raises(InputError, match="is being planned; expected its end"):
        page.goal.plan()
    answer("", "start: in collision")
    values = page.show()
    assert (values["status"], values["can_plan"]) == ("start: in collision", True)
    for text, problem in (("[]", "plan: is not a plan"), ("", "plan is not JSON")):
        page.goal.plan()
        page.asked[-1][2](text, "")
        assert page.show()["status"].startswith(problem)
    page.goal.plan()
    plan = write_approach(tmp_path / "plan.json", robot, moment.content.setup_id)
    page.asked[-1][2](plan.read_text(), "")
    values = page.show()
    assert (values["status"], values["is_active"]) == ("planned; nothing has moved", False)
    page.show()
    assert page.part.values()["approach"]["place"] == 20
    assert page.view.added[Part.GHOST]


def test_answer_that_comes_after_the_end_of_its_goal_is_dropped(page, moment, robot, tmp_path):
    plan = write_approach(tmp_path / "plan.json", robot, moment.content.setup_id).read_text()
    for end in (page.goal.end, lambda: None):  # a goal is set in place of another, too
        page.goal.begin(5.0)
        page.goal.plan()
        old = page.asked[-1][2]
        end()
        page.goal.begin(5.0)
        for text, problem in ((plan, ""), ("", "out of time")):
            old(text, problem)
            values = page.show()
            assert (values["is_active"], values["status"], values["can_plan"]) == (True, "", True)
        page.goal.plan()
        old(plan, "")
        values = page.show()
        assert (values["is_active"], values["status"]) == (True, "planning...")
        assert page.part.values()["approach"] is None
    assert page.cancelled == [1, 2, 3]
    page.asked[-1][2]("", "start: in collision")
    assert page.show()["status"] == "start: in collision"


def test_goal_that_moves_cancels_the_plan_for_its_earlier_place(page, moment, robot, tmp_path):
    plan = write_approach(tmp_path / "plan.json", robot, moment.content.setup_id).read_text()
    page.goal.begin(5.0)
    page.goal.plan()
    page.goal.move_to(page.goal.place_mm + STEP_MM)
    page.asked[-1][2](plan, "")
    values = page.show()
    assert (page.cancelled, values["is_active"], values["can_plan"]) == ([1], True, True)
    assert values["status"] == "cancelled: the goal has moved; plan again"
    assert page.part.values()["approach"] is None


def test_goal_needs_the_present_place_of_the_tool(page, moment):
    unknown = replace(moment.step, links={})
    for changes, problem in (
        ({"silent": "no step has followed"}, "goal: no step has followed; expected the present"),
        ({"step": unknown}, "goal: the robot's joints are not known; expected the present"),
    ):
        page.show(**changes)
        page.goal.begin(5.0)
        values = page.show(**changes)
        assert values["status"].startswith(problem)
        assert values["is_active"] is False
    page.show(content=replace(moment.content, robot=None))
    assert page.part.values()["goal"] is None


def test_pointer_drags_the_ghost(page):
    drag = GoalDrag(page.view, page.goal, lambda: None)
    middle = np.array([0.5, 0.5])
    assert not drag.take("page1", event("LeftButtonPress", middle))  # there is no goal
    page.goal.begin(5.0)
    page.show()
    ras_from_root, tip_mm = drag._tip()
    picture = PicturePoints(page.view)
    at = picture.projected(tip_mm[None])[0]
    assert drag.take("page1", event("LeftButtonPress", at))
    assert not drag.take("page2", event("MouseMove", at))
    before = page.goal.place_mm
    assert drag.take("page1", event("MouseMove", at + WAY))
    moved_mm = ras_from_root[:3, :3] @ (page.goal.place_mm - before)
    shown = picture.projected((tip_mm + moved_mm)[None])[0]
    np.testing.assert_allclose(shown, at + WAY, atol=1e-6)
    assert drag.take("page1", event("LeftButtonRelease", at))
    np.testing.assert_allclose(page.goal.place_mm, before, atol=1e-6)
    assert not drag.take("page1", event("MouseMove", at))
    assert not drag.take("page1", event("LeftButtonPress", np.array([0.001, 0.999])))
