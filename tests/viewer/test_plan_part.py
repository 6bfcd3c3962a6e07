"""Plans on the page: the ghost of an approach, and the needle on its corridor."""

from dataclasses import replace
from types import SimpleNamespace

import msgpack
import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import InputError, Transform
from app.registration import DriftBound, given_registration
from app.robot import load_robot
from app.scene.convert import world_matrix, world_points
from app.scene.planned_models import GHOST_OPACITY, PLAN_COLOR
from app.session import RobotSetup
from app.viewer import SceneView
from app.viewer.drawing.scene_view import Part
from app.viewer.plan_part import PlanPart, planned_parts
from app.workflow import ApproachGhost, NeedleGuide
from tests.planning.plan_files import TURN_RAD, write_approach, write_needle
from tests.tiers import PROJECT_ROOT
from tests.viewer.viewed_case import BREACH_FRAME, LOST

pytestmark = pytest.mark.slow

TOUCH = PROJECT_ROOT / "data" / "robots" / "touch" / "touch.urdf"
OUTSIDE = 0
BASE_MM = [300.0, 0.0, -100.0]


@pytest.fixture(scope="module")
def robot():
    return load_robot(TOUCH)


@pytest.fixture(scope="module")
def shown(parts, robot):
    """``shown(frame)``: a moment of the small case, whose session has a robot that is at rest."""
    registration = given_registration(Transform("reference", "robot_base", np.eye(3), BASE_MM))
    setup = RobotSetup(robot, "robot_base", "stylus", registration, DriftBound(5.0, 0.1))
    content = parts.content
    reference = Transform.identity("needle", "reference")
    edges = (*content.static_edges, reference, registration.transform)
    content = replace(content, robot=setup, static_edges=edges)
    return lambda frame: replace(parts.feed.shown[frame], content=content)


@pytest.fixture
def page(can_draw, shown):
    """The view with both plans, at the first moment."""
    ghost, needle = ApproachGhost(), NeedleGuide()
    view = SceneView(shown(0).content, added=(Part.GHOST, Part.CORRIDOR))
    view.view.render_window().SetSize(640, 400)
    part = PlanPart(ghost, needle)

    def show(frame, **changes):
        moment = replace(shown(frame), **changes)
        view.show(moment)
        return part.update(moment, view)

    show(0)
    return SimpleNamespace(ghost=ghost, needle=needle, view=view, part=part, show=show)


def nodes(view):
    return view.application.scene.GetNumberOfNodes()


def test_ghost_is_the_robot_at_the_chosen_time_of_the_plan(page, shown, robot, tmp_path):
    content, before = shown(0).content, nodes(page.view)
    page.ghost.read(write_approach(tmp_path / "plan.json", robot, content.setup_id))
    assert page.show(0)
    models = page.view.added[Part.GHOST]
    assert set(models) == {link.name for link in robot.links if link.visuals}
    base = world_matrix(page.view.scene.tree.node("robot_base"))
    held = dict.fromkeys(robot.actuated_joint_names[1:], 0.1)
    values = page.part.values()["approach"]
    assert (values["place"], values["last"], values["nearest"]) == (20, 20, "20.0 mm from ball")
    for place, turn, nearest in ((20, TURN_RAD, "20.0"), (0, 0.0, "30.0"), (10, None, "25.0")):
        page.ghost.go_to(place)
        assert not page.show(0)  # the models stay
        assert page.part.values()["approach"]["nearest"] == f"{nearest} mm from ball"
        if turn is None:
            continue
        links = robot.forward_kinematics({**held, "waist": turn})
        for name, model in models.items():
            found = world_matrix(model.GetParentTransformNode())
            np.testing.assert_allclose(found, base @ links[name].matrix, atol=1e-9)
            assert model.GetDisplayNode().GetColor() == pytest.approx(PLAN_COLOR)
            assert model.GetDisplayNode().GetOpacity() == pytest.approx(GHOST_OPACITY)
    page.ghost.go_to(1_000_000)
    assert page.part.values()["approach"]["place"] == 10  # drawn until the next moment
    page.show(0)
    assert page.part.values()["approach"]["place"] == 20
    assert page.part.values()["approach"]["clearance"] == "at least 5 mm on the whole way"
    page.ghost.remove()
    assert page.show(0)
    assert nodes(page.view) == before
    assert page.part.values()["approach"] is None


@pytest.mark.parametrize(
    ("setup_id", "changes", "problem"),
    [
        ("other", {}, "plan: is of the setup 'other'; expected '{}' of the guard, or a new plan"),
        ("", {}, "plan: has no setup_id; expected one made with --guard"),
        (None, {"robot": "panda"}, "plan: is of robot 'panda'; expected 'touch'"),
        (None, {"held": {}}, "plan: has the joints waist; expected waist, shoulder, elbow, "),
    ],
)
def test_approach_of_another_session_is_refused(
    page, shown, robot, tmp_path, setup_id, changes, problem
):
    known = shown(0).content.setup_id
    path = tmp_path / "plan.json"
    page.ghost.read(write_approach(path, robot, known if setup_id is None else setup_id, **changes))
    assert not page.show(0)
    assert page.view.added[Part.GHOST] == {}
    values = page.part.values()["approach"]
    assert values["problem"].startswith(problem.format(known))
    assert values["time"] == values["nearest"] == ""


def test_ghost_leaves_a_session_whose_setup_changes(page, shown, robot, tmp_path):
    content = shown(0).content
    page.ghost.read(write_approach(tmp_path / "plan.json", robot, content.setup_id))
    page.show(0)
    moved = Transform("needle", "tumor", np.eye(3), [0.0, 0.0, 1.0])
    assert page.show(0, content=content.with_edge(moved.renamed(source=content.tumor.frame)))
    assert page.view.added[Part.GHOST] == {}
    assert "expected" in page.part.values()["approach"]["problem"]
    assert page.show(0)
    assert page.part.values()["approach"]["problem"] == ""


def test_ghost_needs_a_registered_base(page, shown, robot, tmp_path):
    content = shown(0).content
    content = replace(content, robot=replace(content.robot, registration=None))
    page.ghost.read(write_approach(tmp_path / "plan.json", robot, content.setup_id))
    assert not page.show(0, content=content)
    expected = "robot: its base is not registered; expected a registration"
    assert page.part.values()["approach"]["problem"] == expected


def test_executed_plan_goes_first_and_ends(page, shown, robot, tmp_path):
    path = write_approach(tmp_path / "plan.json", robot, shown(0).content.setup_id)
    page.ghost.read(path)
    page.show(0)
    page.ghost.execute(path.read_text())
    assert page.part.values()["approach"]["title"] == "plan of a file"  # it is still drawn
    page.ghost.remove()
    page.show(0)
    assert page.part.values()["approach"]["title"] == "the arm executes this plan"
    page.ghost.execute("[]")
    assert page.show(0)
    assert page.part.values()["approach"]["problem"].startswith("plan: is not a plan (TypeError")
    page.ghost.execute("")
    page.show(0)
    assert page.part.values()["approach"] is None


@pytest.mark.parametrize("name", ["\ud800", "x" * 1_000_000])
def test_names_of_a_received_plan_do_not_keep_the_page_from_its_state(
    page, shown, robot, tmp_path, name
):
    path, known = tmp_path / "plan.json", shown(0).content.setup_id
    for changes in (
        {"preview": {"samples": [0], "nearest": [[name, 1.0]]}},
        {"held": {name: 0.0}},
        {"robot": [name]},
    ):
        page.ghost.execute(write_approach(path, robot, known, **changes).read_text())
        page.show(0)
        assert 0 < len(msgpack.packb(page.part.values())) < 2000


def test_plan_without_distances_says_so(page, shown, robot, tmp_path):
    known = shown(0).content.setup_id
    for preview, nearest in (
        (None, "no distances in the plan"),
        ({"samples": [0, 3], "nearest": []}, "no structure"),
    ):
        page.ghost.read(write_approach(tmp_path / "plan.json", robot, known, preview=preview))
        page.show(0)
        values = page.part.values()["approach"]
        assert (values["nearest"], values["problem"]) == (nearest, "")
        assert page.view.added[Part.GHOST]
        assert values["time"].startswith("0.90 of " if preview is None else "0.03 of ")


@pytest.mark.parametrize(
    "changes",
    [
        {"samples": []},
        {"samples": [0, 0]},
        {"samples": [0, 100_000]},
        {"samples": [0.5]},
        {"samples": [0], "nearest": [["ball", float("nan")]]},
        {"samples": [0], "nearest": [["ball", 1.0], ["ball", 1.0]]},
    ],
)
def test_file_with_a_wrong_preview_is_named(robot, tmp_path, changes):
    preview = {"nearest": []} | changes
    path = write_approach(tmp_path / "plan.json", robot, "setup", preview=preview)
    with pytest.raises(InputError, match=r"plan\.json: is not a plan"):
        ApproachGhost().read(path)


@pytest.fixture
def planned(page, shown, tmp_path):
    """The tip of the rod is 2, -3 mm beside the first corridor and 20 mm before its target."""
    step, content = shown(BREACH_FRAME).step, shown(BREACH_FRAME).content
    tip = step.edges.between("needle", "rod_tip")[0]
    assert content.tip_frame == "rod_tip"
    x, y, z = tip.rotation.T

    def corridor(aside_mm):
        target = tip.translation_mm - aside_mm * x + 3.0 * y + 20.0 * z
        return (target - 60.0 * z).tolist(), target.tolist()

    pose = step.edges.between("needle", content.tumor.frame)[0]

    def read(**changes):
        corridors = corridor(2.0), corridor(4.0)
        path = write_needle(tmp_path / "needle.json", content.setup_id, pose, *corridors, **changes)
        page.needle.read(path)
        page.show(BREACH_FRAME)
        return page.part.values()["guidance"]

    return read


def test_needle_is_guided_by_the_steps(page, planned):
    values = planned()
    assert values["problem"] == ""
    assert values["lateral"] == f"{np.hypot(2.0, 3.0):.1f} mm"
    assert (values["angle"], values["remaining"]) == ("0.0\N{DEGREE SIGN}", "20.0 mm")
    assert values["miss"] == values["lateral"]
    assert np.hypot(*values["tip"]) == pytest.approx(np.hypot(2.0, 3.0), abs=0.02)
    assert values["tip"] == pytest.approx(values["axis"], abs=0.02)
    right, down, left, up = values["letters"]
    assert {right, left} | {down, up} <= set("RLAPSI")  # the rod stands upright
    page.needle.choose(1)
    page.show(BREACH_FRAME)
    assert page.part.values()["guidance"]["lateral"] == "5.0 mm"
    with pytest.raises(InputError, match="corridor: is 2; expected one of 2"):
        page.needle.choose(2)
    page.show(BREACH_FRAME + 2)  # the rod has moved by 3 mm along x
    assert page.part.values()["guidance"]["lateral"] != "5.0 mm"


def test_corridor_is_drawn_from_entry_to_target_in_its_frame(page, planned):
    planned()
    model = page.view.added[Part.CORRIDOR]["corridor"]
    points = world_points(model)
    middle, (entry, target) = points.mean(axis=0), _ends(page)
    np.testing.assert_allclose(middle, (entry + target) / 2.0, atol=1e-6)
    along = (points - entry) @ ((target - entry) / 60.0)
    assert (along.min(), along.max()) == pytest.approx((0.0, 60.0), abs=1e-4)
    assert np.linalg.norm(points - middle, axis=1).max() == pytest.approx(
        np.hypot(30.0, 0.6), abs=1e-3
    )
    page.needle.remove()
    assert page.show(BREACH_FRAME)
    assert page.view.added[Part.CORRIDOR] == {}
    assert page.part.values()["guidance"] is None


def _ends(page):
    path = page.needle._plan.paths[0]
    base = world_matrix(page.view.scene.tree.node(path.frame))
    return [base[:3, :3] @ each + base[:3, 3] for each in (path.entry_mm, path.target_mm)]


def test_gate_is_closed_in_the_tumour_and_on_hold(page, planned, shown):
    values = planned()
    assert (values["gate"], values["gate_text"]) == ("closed", "the margin is POSITIVE")
    page.show(OUTSIDE)
    assert page.part.values()["guidance"]["gate"] == "open"
    step = shown(OUTSIDE).step
    held = replace(step, decision=step.decision._replace(hold=True))
    page.show(OUTSIDE, step=held)
    values = page.part.values()["guidance"]
    assert (values["gate"], values["gate_text"]) == ("closed", "the guard is on hold")


def test_gate_closes_while_the_target_is_away(page, planned, shown):
    content = shown(BREACH_FRAME).content
    pose = shown(BREACH_FRAME).step.edges.between("needle", content.tumor.frame)[0]
    away = Transform(
        "needle",
        content.tumor.frame,
        pose.rotation,
        pose.translation_mm + np.array([0.0, 0.0, 3.0]),
    )
    planned(frame_from_target=away.matrix.tolist())
    page.show(OUTSIDE)
    values = page.part.values()["guidance"]
    assert values["gate"] == "closed"
    assert values["gate_text"] == "target 3.0 mm from its planned place, window 1 mm"
    assert planned(window_mm=None)["gate"] == ""


def test_needle_is_not_guided_by_what_cannot_be_trusted(page, planned, shown):
    planned()
    lost = LOST[1]
    assert shown(lost).step.decision.state is MarginState.UNKNOWN
    for frame, changes, problem in (
        (lost, {}, "margin: is UNKNOWN ("),
        (BREACH_FRAME, {"silent": "no step has followed"}, "no step has followed"),
    ):
        page.show(frame, **changes)
        values = page.part.values()["guidance"]
        assert values["problem"].startswith(problem)
        assert (values["tip"], values["gate"], values["lateral"]) == (None, "", "")
    refused = planned(setup_id="other")
    assert refused["problem"].startswith("plan: is of the setup 'other'; expected ")
    assert page.view.added[Part.CORRIDOR] == {}


@pytest.mark.parametrize(
    "changes",
    [
        {"corridors": []},
        {"window_mm": -1.0},
        {"window_mm": float("inf")},
        {"frame_from_target": [[2.0, 0.0], [0.0, 1.0]]},
        {"setup_id": ""},
        {"needle": {"diameter_mm": 0.0}},
        {"needle": {"diameter_mm": 10**400}},
        {"needle": []},
        {"corridors": 3},
        {"corridors": [{"entry_mm": [0.0, 0.0, 0.0], "target_mm": [0.0, 0.0, 0.0]}]},
    ],
)
def test_file_that_is_no_needle_plan_is_named(tmp_path, changes):
    pose = Transform.identity("reference", "tumor")
    path = write_needle(tmp_path / "needle.json", "id", pose, ([0, 0, 0], [0, 0, 9]), **changes)
    with pytest.raises(InputError, match=r"needle\.json: is not a plan"):
        NeedleGuide().read(path)


def test_display_lists_the_parts_that_plans_may_have(page, planned):
    assert planned_parts(None) == ()
    assert planned_parts((page.ghost, page.needle)) == (Part.GHOST,)
    planned()
    assert planned_parts((page.ghost, page.needle)) == (Part.GHOST, Part.CORRIDOR)
    page.view.set_visible(Part.CORRIDOR, False)
    assert not page.view.added[Part.CORRIDOR]["corridor"].GetDisplayNode().GetVisibility()
