from collections.abc import Callable

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.fixture import FixtureDecision, MarginState
from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.scene import MarginGuardScene, SceneError
from app.scene.convert import world_matrix, world_points

Decide = Callable[[MarginState, float | None], FixtureDecision]


@pytest.fixture
def shown(
    edges: tuple[Transform, ...],
    fixed: tuple[Transform, ...],
    tumor: SurfaceMesh,
    tool: SurfaceMesh,
    arm: Robot,
) -> MarginGuardScene:
    scene = MarginGuardScene(vtkMRMLScene())
    scene.set_poses(edges, fixed)
    scene.add_tumor(tumor)
    scene.add_tool(tool)
    scene.add_robot("arm", arm, "robot_base")
    return scene


def test_names_are_those_of_slicer_igt(shown: MarginGuardScene) -> None:
    for name in (
        "ReferenceToRas",
        "NeedleToReference",
        "CauteryToReference",
        "CauteryTipToCautery",
        "TumorToNeedle",
        "RobotBaseToReference",
        "Tumor",
        "Tool",
        "ClosestPoints",
        "MarginStatus",
    ):
        assert shown.scene.GetFirstNodeByName(name) is not None, name


def test_surfaces_are_where_the_tracker_saw_them(
    shown: MarginGuardScene,
    edges: tuple[Transform, ...],
    fixed: tuple[Transform, ...],
    tumor: SurfaceMesh,
) -> None:
    # The chain is written out here: it must not come from the code that is tested.
    tracker_from_reference, tracker_from_needle, _ = edges
    reference_from_tumor = tracker_from_reference.inverse() @ tracker_from_needle @ fixed[1]
    wanted = reference_from_tumor.apply(tumor.vertices_mm)
    found = world_points(shown.tumor)
    assert np.allclose(found.mean(axis=0), wanted.mean(axis=0), atol=1e-4)
    assert np.allclose(np.sort(found[:, 0]), np.sort(wanted[:, 0]), atol=1e-3)
    tip = world_matrix(shown.tree.node("cautery_tip"))
    assert np.allclose(tip, (tracker_from_reference.inverse() @ edges[2] @ fixed[0]).matrix)


@pytest.mark.parametrize("state", list(MarginState))
def test_tumor_has_the_color_of_the_state(
    shown: MarginGuardScene, decision: Decide, state: MarginState
) -> None:
    shown.show(decision(state, 2.0), {})
    assert shown.tumor.GetDisplayNode().GetColor() == state.color
    assert 0.0 < shown.tumor.GetDisplayNode().GetOpacity() < 1.0
    assert shown.margin.status.GetText().startswith(f"{state.name}: ")


def test_line_between_the_closest_points(shown: MarginGuardScene, decision: Decide) -> None:
    shown.show(decision(MarginState.POSITIVE, -3.25), {})
    line = shown.margin.line
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


def test_no_distance_is_shown_while_unknown(shown: MarginGuardScene, decision: Decide) -> None:
    for unknown in (decision(MarginState.UNKNOWN, None), decision(MarginState.UNKNOWN, 2.0)):
        shown.show(decision(MarginState.WARNING, 2.0), {})
        assert shown.margin.line.GetDisplayNode().GetVisibility()
        shown.show(unknown, {})
        assert not shown.margin.line.GetDisplayNode().GetVisibility()
        assert "mm" not in shown.margin.status.GetText()


def test_show_moves_the_links(shown: MarginGuardScene, decision: Decide, arm: Robot) -> None:
    links = arm.forward_kinematics({"shoulder": 0.7, "elbow": -0.4})
    shown.show(decision(MarginState.NEGATIVE, 9.0), {"arm": links})
    found = world_matrix(shown.robots["arm"].transforms["fore_arm"])
    assert np.allclose(
        found, world_matrix(shown.tree.node("robot_base")) @ links["fore_arm"].matrix
    )


def test_clear_takes_everything_of_ours(shown: MarginGuardScene, decision: Decide) -> None:
    shown.show(decision(MarginState.POSITIVE, -1.0), {})
    shown.scene.AddNewNodeByClass("vtkMRMLModelNode", "Theirs")
    shown.clear()
    for kind in ("Model", "LinearTransform", "Markups", "Text", "ModelDisplay", "MarkupsDisplay"):
        count = shown.scene.GetNumberOfNodesByClass(f"vtkMRML{kind}Node")
        assert count == (1 if kind == "Model" else 0), kind


def test_scenes_do_not_share_anything(
    shown: MarginGuardScene, edges: tuple[Transform, ...], fixed: tuple[Transform, ...]
) -> None:
    other = MarginGuardScene(vtkMRMLScene())
    other.set_poses(edges, fixed)
    other.add_tip("cautery_tip")
    assert other.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 1
    assert shown.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 5


def test_what_does_not_fit_is_refused(
    shown: MarginGuardScene, decision: Decide, tumor: SurfaceMesh, tool: SurfaceMesh
) -> None:
    with pytest.raises(SceneError, match="a tumour already"):
        shown.add_tumor(tumor)
    with pytest.raises(SceneError, match="a tool already"):
        shown.add_tool(tool)
    empty = MarginGuardScene(vtkMRMLScene())
    with pytest.raises(SceneError, match="frame 'tumor' has no pose"):
        empty.add_tumor(tumor)
    with pytest.raises(SceneError, match="no tumour yet"):
        empty.show(decision(MarginState.NEGATIVE, 9.0), {})
