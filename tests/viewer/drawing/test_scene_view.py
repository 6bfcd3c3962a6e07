"""The scene of the page, against the values of the steps."""

from dataclasses import replace

import numpy as np
import pytest

from app.fixture import MarginState
from app.geometry import Transform
from app.registration import DriftBound, given_registration
from app.robot import Link, Robot, Shape
from app.scene import MarkerStyle
from app.scene.convert import world_matrix, world_points
from app.scene.presenter import GRIP_OPACITY
from app.session import RobotSetup
from app.viewer import SceneView
from app.viewer.address import ViewerError
from app.viewer.drawing.camera_controller import CameraController, CameraPreset
from app.viewer.drawing.render_loop import PictureArea
from app.viewer.drawing.scene_view import Part
from tests.viewer.viewed_case import BREACH_FRAME

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shown_view(can_draw, parts):
    return SceneView(parts.content)


@pytest.fixture
def view(shown_view, parts):
    shown_view.show(parts.feed.shown[0])
    return shown_view


def test_plane_is_hidden_while_the_session_is_silent(view, parts):
    shown = parts.feed.shown[1]
    view.show(shown)
    plane = view.scene.margin.plane.node.GetDisplayNode()
    assert plane.GetVisibility()
    view.show(shown.as_unknown("the session has failed"))
    assert not plane.GetVisibility()


def test_marks_are_those_of_the_breaches_up_to_the_frame(view, parts):
    def marks(frame):
        view.show(parts.feed.shown[frame])
        node = view.scene.margin.breaches.node
        count = node.GetNumberOfControlPoints()
        return {tuple(np.round(node.GetNthControlPointPosition(n), 6)) for n in range(count)}

    for frame in range(40):  # played
        played = marks(frame)
    assert len(played) >= 1
    assert marks(0) == set()
    assert marks(39) == played  # sought: the breach itself was left out
    assert marks(BREACH_FRAME - 5) == set()


def test_deleted_marks_stay_deleted_until_the_replay_goes_back(view, parts):
    def count(frame):
        view.show(parts.feed.shown[frame])
        return len(view.scene.margin.breaches)

    last = len(parts.feed.shown) - 1
    played = count(last)
    assert played >= 1
    breaches = parts.feed.shown[last].breach_list
    view.presenter.delete_breach_marks()
    assert len(view.scene.margin.breaches) == 0
    assert count(last) == 0
    assert parts.feed.shown[last].breach_list is breaches
    assert breaches.count > 0
    count(0)
    assert count(last) == played


def test_marks_have_the_chosen_size_and_distance(view, parts):
    last = parts.feed.shown[-1]
    view.show(last)
    view.presenter.marker_style = MarkerStyle(5.0, 3.0)
    marks = view.scene.margin.breaches
    assert marks.spacing_mm == 5.0
    assert marks.node.GetDisplayNode().GetGlyphSize() == 3.0
    fewer = len(marks)
    view.presenter.marker_style = MarkerStyle()
    assert len(marks) >= fewer >= 1


def test_robot_is_added_when_its_base_becomes_known(can_draw, parts):
    """A session may begin while the reference sensor is not visible."""
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
    view = SceneView(content)
    view.show(first)
    assert not view.scene.robots
    view.set_opacity(Part.ROBOT, 0.5)
    chest = Transform.identity("tracker", "reference")
    links = {"base": Transform.identity("base", "base")}
    seen = replace(second, measured=(*second.measured, chest))
    view.show(replace(seen, step=replace(seen.step, links=links)))
    (model,) = view.scene.robots["block"].models.values()
    assert model.GetDisplayNode().GetOpacity() == pytest.approx(0.5 * GRIP_OPACITY)
    assert model.GetDisplayNode().GetColor() != MarginState.UNKNOWN.color
    controller, renderer = CameraController(view), view.view.renderer()
    managed = view.view.get_displayable_manager_by_class("vtkMRMLModelDisplayableManager")
    for preset, has_inset in (
        (CameraPreset.CLOSE, True),
        (CameraPreset.OVERVIEW, False),
        (CameraPreset.SIDE, True),
        (CameraPreset.BULLSEYE, False),
    ):
        controller.select(preset)
        controller.update()
        view.sort()
        assert view.inset.is_shown == has_inset
        actor = managed.GetActorByID(model.GetDisplayNode().GetID())
        assert renderer.HasViewProp(actor) != has_inset
    view.show(replace(seen, step=replace(seen.step, links={})))
    assert model.GetDisplayNode().GetColor() == MarginState.UNKNOWN.color


def test_scene_is_empty_before_tool_and_tumour_are_known(can_draw, parts):
    view = SceneView(parts.content)
    first = parts.feed.shown[0]
    view.show(replace(first, step=replace(first.step, tumor_from_tip=None)))
    assert view.scene is None
    view.show(first)
    assert view.scene is not None


def test_each_part_has_its_own_visibility_and_opacity(view):
    assert view.parts == (Part.TUMOR, Part.MARGIN, Part.TOOL)
    display = view.scene.tumor.GetDisplayNode()
    own = display.GetOpacity()
    view.set_opacity(Part.TUMOR, 0.5)
    assert display.GetOpacity() == pytest.approx(0.5 * own)
    view.set_visible(Part.TUMOR, False)
    assert not display.GetVisibility()
    assert view.scene.tool.GetDisplayNode().GetVisibility()
    view.set_visible(Part.TUMOR, True)
    view.set_opacity(Part.TUMOR, 1.0)
    assert display.GetOpacity() == pytest.approx(own)
    with pytest.raises(ViewerError, match=r"opacity of tumour is 1\.5; expected 0 to 1"):
        view.set_opacity(Part.TUMOR, 1.5)


def test_bullseye_follows_the_tool_and_other_presets_do_not(view, parts):
    view.view.render_window().SetSize(400, 300)
    controller = CameraController(view)
    camera = view.view.get_camera_node()
    for preset, follows_tool in (
        (CameraPreset.BULLSEYE, True),
        (CameraPreset.CLOSE, False),
        (CameraPreset.OVERVIEW, False),
    ):
        controller.select(preset)
        places = []
        for frame in (0, 15):
            view.show(parts.feed.shown[frame])
            controller.update()
            places.append(np.array(camera.GetFocalPoint()))
            if follows_tool:
                tip = world_matrix(view.scene.tree.node(parts.content.tip_frame))[:3, 3]
                assert np.allclose(places[-1], tip)
        assert np.allclose(*places) != follows_tool
    controller.select(CameraPreset.BULLSEYE)
    assert not view.scene.tool.GetDisplayNode().GetVisibility()
    controller.select(CameraPreset.CLOSE)
    assert view.scene.tool.GetDisplayNode().GetVisibility()


@pytest.mark.parametrize("preset", [CameraPreset.CLOSE, CameraPreset.SIDE])
def test_close_up_contains_tumour_and_tip_at_every_step(view, parts, preset):
    view.view.render_window().SetSize(400, 300)
    controller = CameraController(view)
    controller.select(preset)
    renderer = view.view.renderer()
    for shown in (*parts.feed.shown, parts.feed.shown[0]):
        view.show(shown)
        controller.update()
        tip = world_matrix(view.scene.tree.node(parts.content.tip_frame))[:3, 3]
        for point in (tip, *world_points(view.scene.tumor)[::7]):
            renderer.SetWorldPoint(*point, 1.0)
            renderer.WorldToView()
            assert np.abs(renderer.GetViewPoint()[:2]).max() <= 1.0
    assert not view.inset.is_shown  # there is no robot


def test_camera_moved_by_the_user_stays(view, parts):
    controller = CameraController(view)
    controller.select(CameraPreset.BULLSEYE)
    controller.update()
    controller.release()
    camera = view.view.get_camera_node()
    before = camera.GetPosition()
    view.show(parts.feed.shown[15])
    controller.update()
    assert camera.GetPosition() == before
    assert controller.preset is None


def test_centred_tumour_stays_in_the_middle_without_a_turn(view, parts):
    camera = CameraController(view)
    camera.update()
    node = view.view.get_camera_node()
    camera.keeps_tumor = True
    camera.release()  # the user turns the view
    before = np.subtract(node.GetPosition(), node.GetFocalPoint())
    places = []
    for frame in (0, 10, 20):
        view.show(parts.feed.shown[frame])
        camera.update()
        middle = world_points(view.scene.tumor).mean(axis=0)
        assert np.allclose(node.GetFocalPoint(), middle)
        assert np.allclose(np.subtract(node.GetPosition(), node.GetFocalPoint()), before)
        places.append(middle)
    camera.keeps_tumor = False
    node.SetFocalPoint(1.0, 2.0, 3.0)
    camera.update()
    assert node.GetFocalPoint() == (1.0, 2.0, 3.0)


def test_size_is_used_with_the_next_picture_and_within_limits(can_draw, parts):
    area = PictureArea(SceneView(parts.content).view)
    assert area.take_resized()  # the size before the first page
    for size in ((320, 240), (100_000, 1)):
        area.process_resize_event(*size)
    assert area.take_resized()
    assert area.render_window.GetSize() == (4096, 16)
    assert not area.take_resized()
