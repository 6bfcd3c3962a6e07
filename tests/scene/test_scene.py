import gc
import math
import weakref

import numpy as np
import pytest
from slicer import vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.fixture import MarginState, Reason, constrain, margin_surface
from app.geometry import Stamp, Transform
from app.scene import MarginGuardScene, SceneError
from app.scene.convert import is_at, vtk_matrix, world_matrix, world_points
from app.scene.scene import TOOL_COLOR
from tests.scene.scene_content import set_poses

pytestmark = pytest.mark.slow


@pytest.fixture
def shown(fill):
    return fill(MarginGuardScene(vtkMRMLScene()))


def test_node_names_are_those_of_slicer_igt(shown):
    transforms = "ReferenceToRas NeedleToReference CauteryToReference CauteryTipToCautery"
    others = "TumorToNeedle RobotBaseToReference Tumor Tool ClosestPoints MarginStatus"
    for name in f"{transforms} {others} FixturePlane BreachMarkers".split():
        assert shown.scene.GetFirstNodeByName(name) is not None, name


def test_surfaces_have_the_measured_poses(shown, edges, fixed, tumor):
    # The product is written out here, independent of the code that is tested.
    tracker_from_reference, tracker_from_needle, _ = edges
    reference_from_tumor = tracker_from_reference.inverse() @ tracker_from_needle @ fixed[1]
    expected = reference_from_tumor.apply(tumor.vertices_mm)
    found = world_points(shown.tumor)
    assert np.allclose(found.mean(axis=0), expected.mean(axis=0), atol=1e-4)
    assert np.allclose(np.sort(found[:, 0]), np.sort(expected[:, 0]), atol=1e-3)
    tip = world_matrix(shown.tree.node("cautery_tip"))
    assert np.allclose(tip, (tracker_from_reference.inverse() @ edges[2] @ fixed[0]).matrix)


@pytest.mark.parametrize("state", list(MarginState))
def test_tumor_has_the_color_of_the_state(shown, decision, state):
    shown.show(decision(state, 2.0), {})
    assert shown.tumor.GetDisplayNode().GetColor() == state.color
    assert 0.0 < shown.tumor.GetDisplayNode().GetOpacity() < 1.0
    assert shown.margin.status.GetText().startswith(f"{state.name}: ")


def test_line_between_the_closest_points(shown, decision):
    shown.show(decision(MarginState.POSITIVE, -3.25), {})
    line = shown.margin.line
    assert line.GetLocked()
    assert line.GetNumberOfControlPoints() == 2
    assert [line.GetNthControlPointLabel(i) for i in range(2)] == ["-3.2 mm", ""]
    assert line.GetMeasurement("length").GetValue() == pytest.approx(3.25)
    ends = np.zeros((2, 3))
    for index, end in enumerate(ends):
        line.GetNthControlPointPositionWorld(index, end)
    ras_from_tumor = world_matrix(shown.tree.node("tumor"))
    assert np.allclose(ends[0], (ras_from_tumor @ [0, 0, 12, 1])[:3])
    assert np.allclose(ends[1], (ras_from_tumor @ [0, 0, 8.75, 1])[:3])
    assert "-3.2 mm" in shown.margin.status.GetText()
    shown.show(decision(MarginState.WARNING, 2.0), {})
    assert [line.GetNthControlPointLabel(i) for i in range(2)] == ["", "2.0 mm"]


def test_no_distance_is_shown_while_unknown(shown, decision):
    for unknown in (decision(MarginState.UNKNOWN, None), decision(MarginState.UNKNOWN, 2.0)):
        shown.show(decision(MarginState.WARNING, 2.0), {})
        assert shown.margin.line.GetDisplayNode().GetVisibility()
        shown.show(unknown, {})
        assert not shown.margin.line.GetDisplayNode().GetVisibility()
        assert "mm" not in shown.margin.status.GetText()


def test_show_moves_the_links(shown, decision, arm):
    links = arm.forward_kinematics({"shoulder": 0.7, "elbow": -0.4})
    shown.show(decision(MarginState.NEGATIVE, 9.0), {"arm": links})
    found = world_matrix(shown.robots["arm"].transforms["fore_arm"])
    assert np.allclose(
        found, world_matrix(shown.tree.node("robot_base")) @ links["fore_arm"].matrix
    )


def test_clear_removes_all_nodes_of_the_scene_object(shown, decision, tumor):
    shown.add_margin_surface(margin_surface(tumor, 2.0, spacing_mm=2.0))
    shown.show(constrained(decision(MarginState.POSITIVE, -1.0)), {})
    shown.scene.AddNewNodeByClass("vtkMRMLModelNode", "Theirs")
    shown.clear()
    left = [shown.scene.GetNthNode(place) for place in range(shown.scene.GetNumberOfNodes())]
    assert [node.GetName() for node in left] == ["Theirs"]


def test_closed_scene_is_reported_and_can_be_cleared(shown, decision, edges, tumor, arm):
    shown.scene.Clear(0)
    with pytest.raises(SceneError, match="node 'ReferenceToRas' was removed from the scene"):
        set_poses(shown, edges)
    for change in (
        lambda: shown.show(decision(MarginState.NEGATIVE, 9.0), {}),
        lambda: shown.add_margin_surface(tumor),
        lambda: shown.add_robot("other", arm, "robot_base"),
    ):
        with pytest.raises(SceneError, match="removed from the scene outside of MarginGuard"):
            change()
    shown.clear()
    assert shown.scene.GetNumberOfNodes() == 0


PARTS = ["Tumor", "Tool", "upper_model", "ClosestPoints"]


def remove(node):
    node.GetScene().RemoveNode(node)


@pytest.mark.parametrize(
    ("name", "damage", "problem"),
    [
        *(
            (name, remove, "node '{}' was removed from the scene")
            for name in (*PARTS, "ForeArmToBase", "MarginStatus")
        ),
        *(
            (
                name,
                lambda node: remove(node.GetDisplayNode()),
                "the display of node '{}' was removed",
            )
            for name in (*PARTS, "FixturePlane")
        ),
        # A hardened surface would not move; an empty one would not be seen.
        *(
            (name, replace_surface, "the surface of node '{}' was replaced outside")
            for name in PARTS[:3]
            for replace_surface in (
                lambda node: node.HardenTransform(),
                lambda node: node.SetAndObservePolyData(None),
            )
        ),
    ],
)
def test_damaged_node_is_named_and_the_rest_can_be_cleared(shown, decision, name, damage, problem):
    damage(shown.scene.GetFirstNodeByName(name))
    with pytest.raises(SceneError, match=problem.format(name)):
        shown.show(decision(MarginState.NEGATIVE, 9.0), {})
    shown.clear()
    assert shown.scene.GetNumberOfNodes() == 0


def test_clear_after_close_keeps_nodes_of_the_user(shown):
    """After a close MRML gives the IDs of our display nodes again."""
    ids = {node.GetDisplayNodeID() for node in (shown.tumor, shown.tool, shown.margin.line)}
    shown.scene.Clear(0)
    theirs = [shown.scene.AddNewNodeByClass(f"vtkMRML{kind}Node")
              for kind in ("Model", "Model", "MarkupsFiducial")]  # fmt: skip
    for node in theirs:
        node.CreateDefaultDisplayNodes()
    assert ids & {node.GetDisplayNodeID() for node in theirs}
    shown.clear()
    assert all(node.GetDisplayNode() is not None for node in theirs)


def test_clear_keeps_a_display_that_another_node_shares(shown):
    theirs = shown.scene.AddNewNodeByClass("vtkMRMLModelNode", "Theirs")
    theirs.SetAndObserveDisplayNodeID(shown.tumor.GetDisplayNodeID())
    shown.clear()
    assert theirs.GetDisplayNode() is not None


@pytest.mark.parametrize(
    "name", [*PARTS, "MarginSurface", "ForeArmToBase", "FixturePlane", "BreachMarkers"]
)
def test_node_moved_under_another_parent_is_put_back(shown, decision, tumor, name):
    """Otherwise the tool would be drawn at a wrong place."""
    shown.add_margin_surface(tumor)
    node = shown.scene.GetFirstNodeByName(name)
    before = world_matrix(node.GetParentTransformNode())
    aside = shown.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "Theirs")
    for parent_id in (None, aside.GetID()):
        node.SetAndObserveTransformNodeID(parent_id)
        shown.show(decision(MarginState.NEGATIVE, 9.0), {})
        assert np.array_equal(world_matrix(node.GetParentTransformNode()), before)
        assert node.GetTransformNodeID() not in (None, aside.GetID())


def test_removed_nodes_are_not_referenced(shown, decision):
    shown.show(decision(MarginState.NEGATIVE, 9.0), {})
    (robot,) = shown.robots.values()
    gone = [weakref.ref(node) for node in (*robot.models.values(), shown.tool)]
    shown.remove_robot(*shown.robots)
    del robot
    gc.collect()
    assert [ref() is None for ref in gone] == [True] * (len(gone) - 1) + [False]
    shown.clear()
    gc.collect()
    assert [ref() for ref in gone if ref() is not None] == []


@pytest.mark.parametrize("name", ["CauteryToReference", "CauteryTipToCautery", "ForeArmToBase"])
def test_check_puts_back_what_a_user_moved(fill, name):
    """A paused replay has no next step."""
    shown = fill(MarginGuardScene(vtkMRMLScene(), stale_after_ns=10**9))
    node = shown.scene.GetFirstNodeByName(name)
    before = world_matrix(node)
    node.SetMatrixTransformToParent(vtkMatrix4x4())
    assert not np.allclose(world_matrix(node), before)
    shown.check(0)
    assert np.array_equal(world_matrix(node), before)


def test_check_leaves_the_root_and_watched_frames_where_a_user_moved_them(fill):
    shown = fill(MarginGuardScene(vtkMRMLScene(), stale_after_ns=10**9))
    edits: list[Transform] = []
    shown.tree.on_edit("cautery", edits.append, pytest.fail)
    for name in ("ReferenceToRas", "CauteryToReference"):
        node = shown.scene.GetFirstNodeByName(name)
        moved = vtk_matrix(Transform("a", "b", np.eye(3), [7.0, 0.0, 0.0]))
        node.SetMatrixTransformToParent(moved)
        shown.check(0)
        assert is_at(node, moved)
    assert len(edits) == 1


def test_line_and_plane_hidden_by_a_user_stay_hidden_until_they_become_known_again(shown, decision):
    known = constrained(decision(MarginState.NEGATIVE, 9.0))
    unknown = decision(MarginState.UNKNOWN, None)
    displays = [each.GetDisplayNode() for each in (shown.margin.line, shown.margin.plane.node)]
    seen = []
    for step, wish in ((known, None), (known, False), (known, None), (unknown, None),
                       (unknown, True), (known, None), (known, None)):  # fmt: skip
        for display in displays:
            if wish is not None:
                display.SetVisibility(wish)
        shown.show(step, {})
        seen.append([bool(display.GetVisibility()) for display in displays])
    assert [line for line, _ in seen] == [True, False, False, False, False, True, True]
    assert [plane for _, plane in seen] == [line for line, _ in seen]


def test_point_colours_set_by_a_user_do_not_hide_the_state(shown, decision):
    display = shown.tumor.GetDisplayNode()
    display.SetActiveScalar("Normals", 0)
    display.SetScalarVisibility(True)
    shown.show(decision(MarginState.UNKNOWN, None), {})
    assert not display.GetScalarVisibility()


def constrained(decision, *, current=True, stamp_ns=None, frame="tumor"):
    """``decision`` with planes 1 mm outside of the tumour, and the stamp of its data."""
    return decision._replace(
        constraint=constrain(decision.proximity, 1.0, frame=frame),
        constraint_is_current=current,
        stamp=decision.stamp if stamp_ns is None else Stamp(stamp_ns),
    )


def test_plane_is_shown_while_it_is_known(shown, decision):
    plane = shown.margin.plane.node
    assert not plane.GetDisplayNode().GetVisibility()
    shown.show(constrained(decision(MarginState.NEGATIVE, 9.0)), {})
    assert plane.GetDisplayNode().GetVisibility()
    center = np.zeros(3)
    plane.GetCenterWorld(center)
    ras_from_tumor = world_matrix(shown.tree.node("tumor"))
    assert np.allclose(center, (ras_from_tumor @ [0, 0, 13, 1])[:3])
    # The last known plane is that of a pose that the tool may have left.
    shown.show(constrained(decision(MarginState.UNKNOWN, 9.0), current=False), {})
    assert not plane.GetDisplayNode().GetVisibility()
    shown.show(decision(MarginState.NEGATIVE, 9.0), {})
    assert not plane.GetDisplayNode().GetVisibility()


@pytest.mark.parametrize("current", [True, False])
def test_constraint_in_another_frame_is_refused(shown, decision, current):
    elsewhere = constrained(decision(MarginState.NEGATIVE, 9.0), current=current, frame="needle")
    with pytest.raises(
        SceneError, match="constraint: frame is 'needle'; expected 'tumor', the tumour's"
    ):
        shown.show(elsewhere, {})
    assert shown.margin.state is MarginState.UNKNOWN
    assert not shown.margin.plane.node.GetDisplayNode().GetVisibility()


def test_breaches_leave_marks_in_the_tumor(shown, decision, edges):
    marks = shown.margin.breaches
    for state, distance_mm in (
        (MarginState.NEGATIVE, 9.0),
        (MarginState.POSITIVE, 0.5),  # not yet released, but outside
        (MarginState.UNKNOWN, -3.0),
        (MarginState.UNKNOWN, None),
    ):
        shown.show(decision(state, distance_mm), {})
    assert len(marks) == 0
    for distance_mm in (-2.0, -2.5, -4.0, -2.0):
        shown.show(decision(MarginState.POSITIVE, distance_mm), {})
    assert len(marks) == 2
    shift = Transform("needle", "tumor", np.eye(3), np.array([5.0, 0.0, 0.0]))
    set_poses(shown, (), [shift])  # tissue moves, and its marks with it
    found = [marks.node.GetNthControlPointPositionWorld(place) for place in range(2)]
    ras_from_tumor = world_matrix(shown.tree.node("tumor"))
    for point, depth_mm in zip(found, (2.0, 4.0), strict=True):
        assert np.allclose(point, (ras_from_tumor @ [0, 0, 12 - depth_mm, 1])[:3])
    marks.clear()
    assert len(marks) == 0


def test_margin_surface_is_faint_around_the_tumor(shown, tumor):
    for margin_mm in (1.0, 2.5):  # the second takes the first one's place
        node = shown.add_margin_surface(margin_surface(tumor, margin_mm, spacing_mm=2.0))
        assert node.GetName() == "MarginSurface"
        assert node.GetParentTransformNode() is shown.tree.node("tumor")
        assert 0.0 < node.GetDisplayNode().GetOpacity() < 0.3
        center = world_matrix(shown.tree.node("tumor"))[:3, 3]
        radii = np.linalg.norm(world_points(node) - center, axis=1)
        assert radii.max() == pytest.approx(12.0 + margin_mm, abs=0.1)
    assert shown.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 6


GREY = MarginState.UNKNOWN.color
STALE_NS = 200_000_000


@pytest.fixture
def live(fill):
    return fill(MarginGuardScene(vtkMRMLScene(), stale_after_ns=STALE_NS))


def assert_shown_stale(scene, why):
    assert scene.tumor.GetDisplayNode().GetColor() == GREY
    assert scene.tool.GetDisplayNode().GetColor() == GREY
    assert not scene.margin.line.GetDisplayNode().GetVisibility()
    assert not scene.margin.plane.node.GetDisplayNode().GetVisibility()
    assert scene.margin.status.GetText() == f"UNKNOWN: not to be trusted, {why}"


def assert_shown_green(scene):
    assert scene.tumor.GetDisplayNode().GetColor() == MarginState.NEGATIVE.color
    assert scene.tool.GetDisplayNode().GetColor() == TOOL_COLOR
    assert scene.margin.line.GetDisplayNode().GetVisibility()
    assert scene.margin.plane.node.GetDisplayNode().GetVisibility()
    assert scene.margin.status.GetText() == "NEGATIVE: clear, 9.0 mm"


@pytest.mark.parametrize(
    ("age_ns", "why"),
    [
        (0, None),
        (STALE_NS, None),
        (STALE_NS + 1, "data 0.2 s old"),
        (30_000_000_000, "data 30.0 s old"),
        (-1_500_000_000, "data from 1.5 s ahead"),
    ],
)
def test_decision_of_old_data_is_grey(live, decision, age_ns, why):
    clear = constrained(decision(MarginState.NEGATIVE, 9.0), stamp_ns=10**12)
    live.show(clear, {}, 10**12 + age_ns)
    if why is None:
        assert_shown_green(live)
    else:
        assert_shown_stale(live, why)
        # Also an old breach is grey, and leaves no mark.
        live.show(decision(MarginState.POSITIVE, -3.0)._replace(stamp=clear.stamp), {}, 0)
        assert live.tumor.GetDisplayNode().GetColor() == GREY
        assert len(live.margin.breaches) == 0


def test_check_turns_everything_grey_after_the_source_stopped(live, decision, arm):
    links = {"arm": arm.forward_kinematics({})}
    clear = constrained(decision(MarginState.NEGATIVE, 9.0), stamp_ns=10**12)
    live.show(clear, links, 10**12)
    live.check(10**12 + STALE_NS)
    assert_shown_green(live)
    link = live.robots["arm"].models["upper"].GetDisplayNode()
    assert link.GetScalarVisibility()
    live.check(10**12 + STALE_NS + 1)
    assert_shown_stale(live, "data 0.2 s old")
    assert not link.GetScalarVisibility() and link.GetColor() == GREY
    live.check(10**12 + 3 * 10**9)
    assert_shown_stale(live, "data 3.0 s old")
    live.show(clear._replace(stamp=Stamp(2 * 10**12)), links, 2 * 10**12)
    assert_shown_green(live)
    assert link.GetScalarVisibility()


def test_before_the_first_decision_everything_is_grey(live):
    link = live.robots["arm"].models["upper"].GetDisplayNode()
    for node in (live.tumor.GetDisplayNode(), live.tool.GetDisplayNode(), link):
        assert node.GetColor() == GREY
    assert not link.GetScalarVisibility()
    assert live.check(10**12) == ()
    assert_shown_stale(live, "no data yet")


LOST = (Reason.MISSING, Reason.FROZEN, Reason.LATCHED)


@pytest.mark.parametrize(
    ("state", "distance_mm", "changes", "why"),
    [
        (MarginState.NEGATIVE, 9.0, {"stamp": None}, "no data yet"),
        (MarginState.UNKNOWN, None, {"stamp": None, "reasons": LOST}, "missing, frozen"),
        *(
            (state, distance_mm, {"stamp": Stamp(10**12)}, "no distance")
            for state in (MarginState.NEGATIVE, MarginState.WARNING, MarginState.POSITIVE)
            for distance_mm in (None, math.nan)
        ),
    ],
)
def test_decision_that_cannot_be_trusted_is_grey_and_says_why(
    live, decision, state, distance_mm, changes, why
):
    live.show(decision(state, distance_mm)._replace(**changes), {}, 10**12)
    assert_shown_stale(live, why)


def test_plane_of_an_unknown_margin_is_hidden_when_its_data_are_old(live, decision):
    """If only the registration is at fault, the plane is current."""
    drifted = constrained(decision(MarginState.UNKNOWN, 9.0), stamp_ns=0)
    live.show(drifted, {}, 0)
    assert live.margin.plane.node.GetDisplayNode().GetVisibility()
    live.check(STALE_NS + 1)
    assert_shown_stale(live, "data 0.2 s old")


def test_tool_is_grey_while_the_margin_is_unknown(shown, decision):
    for state in MarginState:
        shown.show(decision(state, 2.0), {})
        assert (shown.tool.GetDisplayNode().GetColor() == GREY) == (state is MarginState.UNKNOWN)


def test_robot_is_grey_while_its_links_are_not_known(live, decision, arm):
    """Decisions continue without joints."""
    link, known = live.robots["arm"].models["upper"].GetDisplayNode(), arm.forward_kinematics({})
    for stamp_ns, links in enumerate(({"arm": known}, {"arm": {}}, {"arm": known}, {})):
        clear = constrained(decision(MarginState.NEGATIVE, 9.0), stamp_ns=stamp_ns)
        live.show(clear, links, stamp_ns)
        is_known = links == {"arm": known}
        assert link.GetScalarVisibility() == is_known
        assert (link.GetColor() == GREY) != is_known
        assert_shown_green(live)
        live.check(stamp_ns)
        assert link.GetScalarVisibility() == is_known


def test_plane_of_a_decision_without_a_stamp_is_hidden(live, decision):
    drifted = constrained(decision(MarginState.UNKNOWN, 9.0))._replace(stamp=None, reasons=())
    live.show(drifted, {}, 0)
    assert not live.margin.plane.node.GetDisplayNode().GetVisibility()


def test_now_ns_is_required_in_a_live_scene_and_refused_in_others(shown, live, decision):
    with pytest.raises(SceneError, match="now_ns is None; expected the present in a live scene"):
        live.show(decision(MarginState.NEGATIVE, 9.0), {})
    with pytest.raises(SceneError, match="now_ns is 5; expected None in a scene"):
        shown.show(decision(MarginState.NEGATIVE, 9.0), {}, 5)
    with pytest.raises(
        SceneError, match="check: the scene has no stale_after_ns; expected a live scene"
    ):
        shown.check(5)


def test_scenes_share_nothing(shown, edges, fixed):
    other = MarginGuardScene(vtkMRMLScene())
    set_poses(other, edges, fixed)
    other.add_tip("cautery_tip")
    assert other.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 1
    assert shown.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 5


def test_second_parts_and_unknown_names_are_refused(shown, decision, tumor, tool):
    with pytest.raises(SceneError, match="already has a tumour; expected 1"):
        shown.add_tumor(tumor)
    with pytest.raises(SceneError, match="already has a tool; expected 1"):
        shown.add_tool(tool)
    with pytest.raises(SceneError, match="robot 'other' is not in the scene; expected one of"):
        shown.show(decision(MarginState.NEGATIVE, 9.0), {"other": {}})
    empty = MarginGuardScene(vtkMRMLScene())
    with pytest.raises(SceneError, match="frame 'tumor' has no pose"):
        empty.add_tumor(tumor)
    with pytest.raises(SceneError, match="the scene has no tumour; expected add_tumor before"):
        empty.show(decision(MarginState.NEGATIVE, 9.0), {})
