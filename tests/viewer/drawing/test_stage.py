"""What stands on the stage, against the numbers of the steps themselves."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import Transform
from app.registration import DriftBound, given_registration
from app.robot import Link, Robot, Shape
from app.scene.nodes.convert import world_matrix, world_points
from app.scene.presenter import GRIP_OPACITY
from app.session import RobotSetup
from app.viewer import SceneView
from app.viewer.drawing.cameras import CameraController, CameraPreset
from app.viewer.drawing.scene_view import Part
from app.viewer.errors import ViewerError
from tests.viewer.viewed_case import BREACH_FRAME, LOST


@pytest.fixture(scope="module")
def shown_stage(can_draw, parts):
    return SceneView(parts.content)


@pytest.fixture
def stage(shown_stage, parts):
    shown_stage.show(parts.feed.shown[0])
    return shown_stage


def tumor_from_tip(stage, tip_frame):
    tree = stage.scene.tree
    return np.linalg.inv(world_matrix(tree.node("tumor"))) @ world_matrix(tree.node(tip_frame))


def test_tool_is_placed_as_each_step_judged_it(stage, parts):
    for frame in (0, BREACH_FRAME, 39, 3):
        shown = parts.feed.shown[frame]
        stage.show(shown)
        found = tumor_from_tip(stage, parts.content.tip_frame)
        assert np.allclose(found, shown.step.tumor_from_tip.matrix, atol=1e-9)


def test_tumour_has_the_colour_of_the_step(stage, parts):
    for frame in (BREACH_FRAME, LOST[0], 0):
        shown = parts.feed.shown[frame]
        stage.show(shown)
        assert stage.scene.tumor.GetDisplayNode().GetColor() == shown.step.decision.state.color


def test_plane_is_hidden_while_the_session_is_silent(stage, parts):
    shown = parts.feed.shown[1]
    stage.show(shown)
    plane = stage.scene.margin.plane.node.GetDisplayNode()
    assert plane.GetVisibility()
    stage.show(shown.as_unknown("the session has failed"))
    assert not plane.GetVisibility()


def test_marks_are_those_of_the_breaches_up_to_the_frame(stage, parts):
    def marks(frame):
        stage.show(parts.feed.shown[frame])
        node = stage.scene.margin.breaches.node
        count = node.GetNumberOfControlPoints()
        return {tuple(np.round(node.GetNthControlPointPosition(n), 6)) for n in range(count)}

    for frame in range(40):  # played
        played = marks(frame)
    assert len(played) >= 1
    assert marks(0) == set()
    assert marks(39) == played  # sought: the breach itself was left out
    assert marks(BREACH_FRAME - 5) == set()


def test_robot_is_added_when_its_base_becomes_known(can_draw, parts):
    """A session may begin while the sensor on the chest is out of sight."""
    block = replace(parts.content.tumor, frame="base")
    base = Transform.identity("reference", "robot_base")
    robot = RobotSetup(
        Robot("block", (Link("base", (Shape(block, None, "block"),)),), ()),
        "robot_base",
        "base",
        given_registration(base),
        DriftBound(translation_mm=1.0, rotation_rad=0.1),
    )
    content = replace(parts.content, robot=robot, static_edges=(*parts.content.static_edges, base))
    first, second = (replace(shown, content=content) for shown in parts.feed.shown[:2])
    stage = SceneView(content)
    stage.show(first)
    assert not stage.scene.robots
    stage.set_opacity(Part.ROBOT, 0.5)
    chest = Transform.identity("tracker", "reference")
    links = {"base": Transform.identity("base", "base")}
    seen = replace(second, measured=(*second.measured, chest))
    stage.show(replace(seen, step=replace(seen.step, links=links)))
    (model,) = stage.scene.robots["block"].models.values()
    assert model.GetDisplayNode().GetOpacity() == pytest.approx(0.5 * GRIP_OPACITY)
    assert model.GetDisplayNode().GetColor() != MarginState.UNKNOWN.color
    stage.show(replace(seen, step=replace(seen.step, links={})))
    assert model.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color


def test_scene_is_empty_before_tool_and_tumour_are_known(can_draw, parts):
    stage = SceneView(parts.content)
    first = parts.feed.shown[0]
    stage.show(replace(first, step=replace(first.step, tumor_from_tip=None)))
    assert stage.scene is None
    stage.show(first)
    assert stage.scene is not None


def test_another_tumour_replaces_the_first(can_draw, parts):
    stage = SceneView(parts.content)
    stage.show(parts.feed.shown[0])
    small = parts.content.tumor
    small = type(small)(small.frame, 0.5 * small.vertices_mm, small.faces)
    other = replace(parts.content, tumor=small)
    nodes = stage.application.scene.GetNumberOfNodes()
    stage.show(replace(parts.feed.shown[1], content=other, margin_surface=None))
    size = np.ptp(world_points(stage.scene.tumor), axis=0)
    assert np.allclose(size, np.ptp(small.vertices_mm, axis=0), atol=1e-3)
    assert stage.scene.margin_surface is None
    stage.show(parts.feed.shown[2])
    assert stage.application.scene.GetNumberOfNodes() == nodes


def test_each_part_has_its_own_visibility_and_opacity(stage):
    assert stage.parts == (Part.TUMOR, Part.MARGIN, Part.TOOL)
    display = stage.scene.tumor.GetDisplayNode()
    own = display.GetOpacity()
    stage.set_opacity(Part.TUMOR, 0.5)
    assert display.GetOpacity() == pytest.approx(0.5 * own)
    stage.set_visible(Part.TUMOR, False)
    assert not display.GetVisibility()
    assert stage.scene.tool.GetDisplayNode().GetVisibility()
    stage.set_visible(Part.TUMOR, True)
    stage.set_opacity(Part.TUMOR, 1.0)
    assert display.GetOpacity() == pytest.approx(own)
    with pytest.raises(ViewerError, match=r"opacity of tumour is 1\.5; expected 0 to 1"):
        stage.set_opacity(Part.TUMOR, 1.5)


def test_bullseye_follows_the_tool_and_other_presets_do_not(stage, parts):
    stage.view.render_window().SetSize(400, 300)
    man = CameraController(stage)
    camera = stage.view.get_camera_node()
    for look, rides in (
        (CameraPreset.BULLSEYE, True),
        (CameraPreset.CLOSE, False),
        (CameraPreset.OVERVIEW, False),
    ):
        man.take(look)
        places = []
        for frame in (0, 15):
            stage.show(parts.feed.shown[frame])
            man.follow()
            places.append(np.array(camera.GetFocalPoint()))
            if rides:
                tip = world_matrix(stage.scene.tree.node(parts.content.tip_frame))[:3, 3]
                assert np.allclose(places[-1], tip)
        assert np.allclose(*places) != rides
    man.take(CameraPreset.BULLSEYE)
    assert not stage.scene.tool.GetDisplayNode().GetVisibility()
    man.take(CameraPreset.CLOSE)
    assert stage.scene.tool.GetDisplayNode().GetVisibility()


def test_camera_moved_by_the_user_stays(stage, parts):
    man = CameraController(stage)
    man.take(CameraPreset.BULLSEYE)
    man.follow()
    man.let_go()
    camera = stage.view.get_camera_node()
    before = camera.GetPosition()
    stage.show(parts.feed.shown[15])
    man.follow()
    assert camera.GetPosition() == before
    assert man.look is None
