"""The mouse on the tool in the picture: what grips it, where it is pulled, what the camera gets."""

import numpy as np
import pytest

from app.scene.convert import world_matrix
from app.viewer import MouseHand, SceneView
from app.viewer.drawing.camera_controller import CameraController
from app.viewer.drawing.grips import ToolGrip, distance_to_segments
from app.viewer.pointer_parts import HandPart, PointerArea
from tests.manual_clock import ManualClock

KEYS = {"ctrlKey": 0, "altKey": 0, "shiftKey": 0}


class RecordedArea:
    """Test double of the picture's area: records what the camera gets."""

    def __init__(self):
        self.events = []

    def update_size(self, origin, size):
        self.events.append("size")

    def on_interaction(self, origin, event):
        self.events.append(event["type"])


@pytest.fixture(scope="module")
def view(can_draw, parts):
    view = SceneView(parts.content)
    view.view.render_window().SetSize(800, 600)
    view.show(parts.feed.shown[0])
    CameraController(view).update()
    return view


@pytest.fixture
def hand():
    return MouseHand(ManualClock())


@pytest.fixture
def part(view, hand):
    return HandPart(view, hand)


def event(kind, at, **keys):
    return {
        "type": kind,
        "x": 800.0 * at[0],
        "y": 600.0 * at[1],
        "w": 800,
        "h": 600,
        **KEYS,
        **keys,
    }


def test_press_on_the_tool_holds_it_where_it_is(view, part, hand, parts):
    tip = parts.feed.shown[0].step.tumor_from_tip.translation_mm
    assert part.take("page1", event("LeftButtonPress", ToolGrip(view).tip_at()))
    np.testing.assert_allclose(hand.target_mm(), tip, atol=1e-6)


def test_pointer_pulls_the_tip_to_what_it_points_at(view, part, hand):
    """Drag the tip onto a point of the tumour's frame in the plane that faces the camera."""
    grip = ToolGrip(view)
    start = grip.tip_at()
    part.take("page1", event("LeftButtonPress", start))
    end = start + np.array([0.1, -0.05])
    assert part.take("page1", event("MouseMove", end))
    np.testing.assert_allclose(grip.shown_at(hand.target_mm()), end, atol=1e-9)
    camera = view.view.renderer().GetActiveCamera()
    matrix = world_matrix(view.scene.tumor.GetParentTransformNode())
    moved = matrix[:3, :3] @ (hand.target_mm() - np.linalg.inv(matrix)[:3] @ [*tip_ras(view), 1.0])
    assert np.linalg.norm(moved) > 1.0
    assert abs(moved @ np.array(camera.GetDirectionOfProjection())) < 1e-6
    assert part.values()["hand"]["pulled"] == pytest.approx(
        [100 * end[0], 100 * (1 - end[1])], abs=0.01
    )


def tip_ras(view):
    return world_matrix(view.scene.tree.node(view.content.tip_frame))[:3, 3]


@pytest.mark.parametrize("end", ["LeftButtonRelease", "RightButtonPress"])
def test_release_or_another_button_lets_go(view, part, hand, end):
    at = ToolGrip(view).tip_at()
    part.take("page1", event("LeftButtonPress", at))
    assert part.take("page1", event(end, at))
    assert hand.holder() is None
    assert part.values()["hand"]["pulled"] is None


def test_closed_page_lets_go(view, part, hand):
    part.take("page1", event("LeftButtonPress", ToolGrip(view).tip_at()))
    part.gone("page2")
    assert hand.holder() == "page1"
    part.gone("page1")
    assert hand.holder() is None


def test_everything_beside_the_tool_is_for_the_camera(view, part, hand):
    area = RecordedArea()
    gripped = PointerArea(area, [part])
    at = ToolGrip(view).tip_at()
    beside = at + np.array([0.3, 0.3])
    for kind in ("LeftButtonPress", "MouseMove", "LeftButtonRelease", "MouseWheel"):
        gripped.on_interaction("page1", event(kind, beside))
    gripped.on_interaction("page1", event("LeftButtonPress", at, shiftKey=1))
    gripped.update_size("page1", {"w": 1.0, "h": 1.0, "p": 1.0})
    assert len(area.events) == 6
    assert hand.holder() is None
    gripped.on_interaction("page1", event("LeftButtonPress", at))
    gripped.on_interaction("page1", event("MouseMove", beside))
    assert len(area.events) == 6
    gripped.on_interaction("page2", event("LeftButtonPress", at))  # another page has its camera
    assert area.events[6:] == ["LeftButtonPress"]
    assert hand.holder() == "page1"


def test_distance_to_segments():
    first, second = np.array([[0.0, 0.0], [5.0, 5.0]]), np.array([[2.0, 0.0], [5.0, 5.0]])
    assert distance_to_segments(np.array([1.0, 0.5]), first, second) == pytest.approx(0.5)
    assert distance_to_segments(np.array([-3.0, 4.0]), first, second) == pytest.approx(5.0)
