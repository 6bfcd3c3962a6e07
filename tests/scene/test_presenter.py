"""Scene of a session, against the values of its content and of its steps."""

from dataclasses import replace

import numpy as np
import pytest

from app.case import Activation
from app.fixture import MarginState
from app.geometry import FrameError, SurfaceMesh, Transform
from app.registration import given_registration
from app.runtime import ShownItem, StructureContent, ToolContent
from app.scene import ScenePresenter
from app.scene.convert import world_matrix, world_points
from app.scene.presenter import GRIP_OPACITY
from app.session import Role, ToolDistance
from app.session.step_result import KnownEdges
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow


@pytest.fixture
def present(application, content):
    def make(content=content, *, is_live=False):
        return ScenePresenter(application.scene, content, is_live=is_live)

    return make


def names(application, class_name):
    found = application.scene.GetNodesByClass(class_name)
    return [found.GetItemAsObject(n).GetName() for n in range(found.GetNumberOfItems())]


def world(presenter, frame):
    return world_matrix(presenter.scene.tree.node(frame))


def tumor_from_tip(edges, fixed):
    _, needle, cautery = edges
    return (needle @ fixed[1]).inverse() @ cautery @ fixed[0]


def test_each_frame_has_one_node(application, present, make_step):
    present().show(make_step())
    expected = ["ReferenceToRas", "TrackerToReference", "NeedleToReference", "CauteryToReference"]
    expected += ["TumorToNeedle", "CauteryTipToCautery", "RobotBaseToReference"]
    expected += ["BaseToRobotBase", "UpperToBase", "ForeArmToBase"]
    assert sorted(names(application, "vtkMRMLLinearTransformNode")) == sorted(expected)


def test_nothing_is_shown_before_the_tumour_is_placed(application, present, make_step, edges):
    presenter = present()
    presenter.show(make_step(measured=(edges[0], edges[2])))
    assert presenter.scene is None
    assert names(application, "vtkMRMLModelNode") == []
    presenter.show(make_step(measured=edges[1:2]))
    assert presenter.scene.reference == "reference"


def test_tool_is_added_when_it_is_placed(present, make_step, edges):
    presenter = present()
    presenter.show(make_step(MarginState.UNKNOWN, None, measured=edges[:2]))
    assert presenter.scene.tumor is not None
    assert presenter.scene.tool is None
    presenter.show(make_step(measured=edges))
    assert presenter.scene.tool is not None


def test_tumour_frame_is_the_root_without_the_reference(present, make_step, edges):
    presenter = present()
    presenter.show(make_step(measured=edges[1:]))
    assert presenter.scene.reference == "needle"
    assert not presenter.scene.robots


def test_robot_is_added_when_its_base_and_its_links_are_known(present, make_step, edges):
    presenter = present()
    presenter.show(make_step(measured=edges[1:]))
    presenter.show(make_step(links={}))
    assert not presenter.scene.robots
    presenter.show(make_step())
    assert list(presenter.scene.robots) == ["arm"]
    fore_arm = presenter.scene.robots["arm"].models["fore_arm"].GetDisplayNode()
    upper = presenter.scene.robots["arm"].models["upper"].GetDisplayNode()
    assert (fore_arm.GetOpacity(), upper.GetOpacity()) == (GRIP_OPACITY, 1.0)
    assert fore_arm.GetScalarVisibility()
    presenter.show(make_step(links={}))
    assert not fore_arm.GetScalarVisibility()


def test_tool_is_placed_relative_to_the_tumour_as_the_step_judged_it(
    present, make_step, edges, fixed
):
    presenter = present()
    presenter.show(make_step())
    earlier = posed("cautery", "cautery", [0.0, 0.1, 0.0], [1.0, 2.0, 3.0])
    judged = tumor_from_tip((edges[0], edges[1], edges[2] @ earlier), fixed)
    presenter.show(make_step(measured=edges[:2], tumor_from_tip=judged))
    found = np.linalg.inv(world(presenter, "tumor")) @ world(presenter, "cautery_tip")
    np.testing.assert_allclose(found, judged.matrix, atol=1e-9)


def test_given_edges_replace_those_of_the_steps_shown_before(present, make_step, edges):
    presenter = present()
    moved = edges[2] @ Transform("cautery", "cautery", np.eye(3), np.array([9.0, 0.0, 0.0]))
    presenter.show(make_step(measured=(*edges[:2], moved)))
    later = world(presenter, "cautery")
    presenter.show(make_step(measured=edges[:2]), measured=edges)
    expected = edges[0].inverse() @ edges[2]
    np.testing.assert_allclose(world(presenter, "cautery"), expected.matrix, atol=1e-9)
    assert np.abs(later - expected.matrix).max() > 5.0


def test_another_registration_moves_the_base_and_keeps_the_rest(present, make_step, content, fixed):
    presenter = present()
    presenter.show(make_step())
    tumor = presenter.scene.tumor
    base = Transform("reference", "robot_base", np.eye(3), np.array([5.0, 6.0, 7.0]))
    registered = replace(content.robot, registration=given_registration(base))
    presenter.set_content(replace(content, robot=registered, static_edges=(*fixed[:2], base)))
    presenter.show(make_step())
    assert presenter.scene.tumor is tumor
    np.testing.assert_allclose(world(presenter, "robot_base"), base.matrix, atol=1e-9)


def test_registration_that_is_found_later_adds_the_robot(present, make_step, content):
    unregistered = replace(
        content,
        robot=replace(content.robot, registration=None),
        static_edges=content.static_edges[:2],
    )
    presenter = present(unregistered)
    presenter.show(make_step())
    assert not presenter.scene.robots
    presenter.set_content(content)
    presenter.show(make_step())
    assert list(presenter.scene.robots) == ["arm"]


def test_another_tumour_replaces_all_of_the_old_one(application, present, make_step, content):
    presenter = present()
    presenter.show(make_step())
    presenter.set_margin_surface(content.tumor)
    assert len(presenter.scene.margin.breaches) == 1
    count = application.scene.GetNumberOfNodes()
    half = SurfaceMesh("tumor", 0.5 * content.tumor.vertices_mm, content.tumor.faces)
    presenter.set_content(replace(content, tumor=half))
    presenter.show(make_step(MarginState.NEGATIVE, 9.0))
    size_mm = np.ptp(world_points(presenter.scene.tumor), axis=0)
    np.testing.assert_allclose(size_mm, 12.0, atol=0.5)
    assert presenter.scene.margin_surface is None
    assert len(presenter.scene.margin.breaches) == 0
    assert names(application, "vtkMRMLModelNode").count("Tumor") == 1
    presenter.set_margin_surface(content.tumor)
    assert application.scene.GetNumberOfNodes() == count


def test_margin_surface_is_removed_when_the_stop_margin_changes(present, make_step, content):
    presenter = present()
    presenter.set_margin_surface(content.tumor)
    presenter.show(make_step())
    assert presenter.scene.margin_surface is not None
    presenter.set_content(replace(content, margins=content.margins.replaced(stop_mm=2.0)))
    assert presenter.scene.margin_surface is None
    presenter.set_margin_surface(content.tumor)
    assert presenter.scene.margin_surface is not None
    assert presenter.scene.tumor is not None


def test_breach_marks_are_those_up_to_the_step(present, make_step):
    points = [np.array([2.0 * place, 0.0, 0.0]) for place in range(4)]
    presenter = present()
    clear = make_step(MarginState.NEGATIVE, 9.0)
    for count in (0, 3, 4, 1):
        presenter.show(clear, breach_points_mm=points[:count])
        assert len(presenter.scene.margin.breaches) == count


def test_live_scene_becomes_unknown_after_the_stale_limit_of_the_content(
    present, make_step, content
):
    limit_ns = content.margins.stale_after_ns
    presenter = present(is_live=True)
    assert presenter.check(0) == ()
    presenter.show(make_step(MarginState.NEGATIVE, 9.0, stamp_ns=100), now_ns=100)
    for now_ns, state in (
        (100 + limit_ns, MarginState.NEGATIVE),
        (101 + limit_ns, MarginState.UNKNOWN),
    ):
        health = presenter.check(now_ns)
        assert presenter.scene.margin.state is state
    assert {each.name for each in health} == {
        "ReferenceToTracker",
        "NeedleToTracker",
        "CauteryToTracker",
    }
    shorter = replace(content, margins=content.margins.replaced(stale_after_ns=limit_ns // 2))
    presenter.set_content(shorter)
    presenter.show(make_step(MarginState.NEGATIVE, 9.0, stamp_ns=100), now_ns=100)
    presenter.check(101 + limit_ns // 2)
    assert presenter.scene.margin.state is MarginState.UNKNOWN


def test_restart_accepts_earlier_samples_and_removes_the_breach_marks(present, make_step):
    presenter = present(is_live=True)
    late_ns = 10**10
    presenter.show(make_step(stamp_ns=late_ns), now_ns=late_ns)
    assert len(presenter.scene.margin.breaches) == 1
    presenter.restart()
    assert len(presenter.scene.margin.breaches) == 0
    presenter.show(make_step(MarginState.NEGATIVE, 9.0, stamp_ns=5), now_ns=5)
    assert {each.age_ns for each in presenter.health(5)} == {0}
    assert presenter.scene.margin.state is MarginState.NEGATIVE


NEEDLE_COLOR = ShownItem("needle", "needle").declared.color


def needle(length_mm, frame="needle"):
    tip = f"{frame}_tip"
    edge = Transform(frame, tip, np.eye(3), [0.0, 0.0, length_mm])
    return ShownItem("needle", frame, length_mm, edge)


def test_needle_is_drawn_at_its_tip_and_follows_its_length(
    application, present, content, make_step
):
    presenter = present(replace(content, items=(needle(60.0),)))
    presenter.show(make_step())
    assert "NeedleTipToNeedle" in names(application, "vtkMRMLLinearTransformNode")
    model, tumor = presenter.scene.items.nodes["needle"], presenter.scene.tumor
    assert model is not None and model.GetName() == "NeedleModel"
    assert model.GetDisplayNode().GetColor() == NEEDLE_COLOR
    sensor = world(presenter, "needle")
    for length_mm in (60.0, 65.0):
        presenter.set_content(replace(content, items=(needle(length_mm),)))
        presenter.show(make_step())
        tip = world(presenter, "needle_tip")
        np.testing.assert_allclose(tip, sensor @ np.array(shifted(length_mm)), atol=1e-9)
        along = (world_points(model) - tip[:3, 3]) @ tip[:3, 2]
        assert (along.min(), along.max()) == pytest.approx((-length_mm, 0.0), abs=1e-3)
    assert presenter.scene.items.nodes["needle"] is model and presenter.scene.tumor is tumor
    presenter.show(make_step(MarginState.UNKNOWN, None))
    assert model.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
    presenter.clear()
    assert "NeedleModel" not in names(application, "vtkMRMLModelNode")


def shifted(length_mm):
    return [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, length_mm], [0, 0, 0, 1]]


def test_needle_on_a_sensor_that_is_not_known_is_grey(present, content, make_step, edges):
    presenter = present(replace(content, items=(needle(40.0, "wire"),)))
    wire = Transform("tracker", "wire", np.eye(3), [1.0, 2.0, 3.0])
    step = make_step(measured=(*edges, wire))
    known = {(each.target, each.source): each for each in step.frame.poses}
    presenter.show(replace(step, edges=KnownEdges((), known)))
    assert presenter.scene is not None
    display = presenter.scene.items.nodes["needle"].GetDisplayNode()
    assert display.GetColor() == NEEDLE_COLOR
    presenter.show(replace(step, edges=KnownEdges((), {**known, ("tracker", "wire"): None})))
    assert display.GetColor() == MarginState.UNKNOWN.color


def test_cautery_has_a_text_node_where_it_is_told(application, present, make_step):
    presenter, step = present(is_live=True), make_step(MarginState.NEGATIVE)
    now_ns = step.frame.stamp.ns
    presenter.show(step, now_ns=now_ns)
    assert application.scene.GetFirstNodeByName("CauteryState") is None
    for state in Activation:
        told = replace(step, frame=replace(step.frame, activation=state))
        presenter.show(told, now_ns=now_ns)
        node = application.scene.GetFirstNodeByName("CauteryState")
        assert node.GetText() == state.label
    presenter.check(now_ns + 10**12)
    assert node.GetText() == "UNKNOWN"
    presenter.clear()
    assert application.scene.GetFirstNodeByName("CauteryState") is None


def test_structures_that_are_added_moved_and_switched_off_are_shown_as_such(
    present, content, make_step
):
    presenter = present()
    presenter.show(make_step())
    assert not presenter.scene.structures.nodes
    surface = SurfaceMesh("vessel", content.tumor.vertices_mm, content.tumor.faces)
    vessel = StructureContent(surface, Role.FORBIDDEN, 1.0, 3.0)
    for parent in ("needle", "reference"):
        edge = Transform(parent, "vessel", np.eye(3), [50.0, 0.0, 0.0])
        presenter.set_content(content.with_structure(vessel, edge))
        presenter.show(make_step())
        assert [*presenter.scene.structures.nodes] == ["vessel"]
        before = world(presenter, "needle") if parent == "needle" else np.eye(4)
        np.testing.assert_allclose(world(presenter, "vessel"), before @ edge.matrix, atol=1e-9)
    presenter.set_content(content)
    presenter.show(make_step())
    assert not presenter.scene.structures.nodes
    assert presenter.scene.tree.node("vessel") is None


def test_other_tool_is_drawn_at_its_tip_in_the_colour_of_its_state(present, content, make_step):
    surface = SurfaceMesh("left_tip", content.tumor.vertices_mm, content.tumor.faces)
    tip = Transform("needle", "left_tip", np.eye(3), [0.0, 0.0, 50.0])
    presenter = present(replace(content, tools=(ToolContent("left", surface, tip),)))
    for state in MarginState:
        presenter.show(replace(make_step(), tools=(ToolDistance("left", state, ()),)))
        node = presenter.scene.structures.nodes["left_tip"]
        assert node.GetName() == "left"
        assert node.GetDisplayNode().GetColor() == state.color
        at = world(presenter, "needle") @ tip.matrix
        np.testing.assert_allclose(world(presenter, "left_tip"), at, atol=1e-9)
    presenter.show(make_step())  # not measured
    assert node.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color
    with pytest.raises(FrameError, match="frame 'left_tip' has 2 parents"):
        vessel = StructureContent(surface, Role.FORBIDDEN, 1.0, 3.0)
        presenter.content.with_structure(vessel, tip)
