import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from slicer import vtkMRMLCameraNode

from app.geometry import Transform
from app.scene import Preset, SceneError, bullseye, forward_of, look_through, preset_camera
from tests.scene.conftest import posed

pytestmark = pytest.mark.slow

three = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
FORWARD = np.array([0.0, 0.0, 1.0])


def seen_at(camera, point, angle_deg=30.0):
    """Where VTK's own camera puts ``point`` in the picture: x and y, -1 to 1 from edge to edge."""
    node = vtkMRMLCameraNode()
    look_through(node, camera, angle_deg)
    matrix = node.GetCamera().GetCompositeProjectionTransformMatrix(1.0, -1.0, 1.0)
    x, y, _, w = matrix.MultiplyPoint((*point, 1.0))
    assert w > 0.0, "behind the camera"
    return np.array([x / w, y / w])


@given(three, three)
def test_bullseye_looks_along_the_tool_at_its_tip(turn, at):
    ras_from_tip = posed("ras", "cautery_tip", turn, at)
    camera = bullseye(ras_from_tip, FORWARD, distance_mm=120.0)
    # The whole axis of the tool, in front of the tip and behind it, is the centre of the picture.
    for along_mm in (-60.0, 0.0, 40.0):
        point = ras_from_tip.apply(along_mm * FORWARD)
        assert np.allclose(seen_at(camera, point), 0.0, atol=1e-6)
    assert np.linalg.norm(camera.position - ras_from_tip.translation_mm) == pytest.approx(120.0)
    # The tool's x-axis is up: a point on it is seen straight above the middle.
    x, y = seen_at(camera, ras_from_tip.apply([5.0, 0.0, 0.0]))
    assert abs(x) < 1e-6 < y


def test_bullseye_with_previous_up_does_not_turn_with_the_tool():
    up = None
    for angle in np.linspace(0.0, 3.0, 20):
        rolled = posed("ras", "tip", angle * FORWARD, [1.0, 2.0, 3.0])
        camera = bullseye(rolled, FORWARD, distance_mm=50.0, previous_up=up)
        assert up is None or np.allclose(camera.up, up)
        up = camera.up
    # A previous up direction along the tool is replaced by the tool's own.
    camera = bullseye(rolled, FORWARD, distance_mm=50.0, previous_up=FORWARD)
    assert abs(camera.up @ FORWARD) < 1e-9


@pytest.mark.parametrize(("forward", "distance_mm"), [((0, 0, 0), 10), ((0, 0, 1), 0)])
def test_bullseye_without_direction_or_distance_is_refused(forward, distance_mm):
    with pytest.raises(SceneError, match="expected a finite direction and a distance above 0"):
        bullseye(
            Transform.identity("ras", "tip"), np.array(forward, float), distance_mm=distance_mm
        )


def test_forward_is_from_the_shaft_to_the_tip(tool, tumor):
    assert np.allclose(forward_of(tool), FORWARD)
    with pytest.raises(SceneError, match="its middle is at its tip; expected a mesh on one side"):
        forward_of(tumor)


@pytest.mark.parametrize(
    ("preset", "right", "up"),
    # What is seen on the right of the picture and above: radiology's letters, in RAS.
    [
        (Preset.ANTERIOR, (-1, 0, 0), (0, 0, 1)),  # the patient's left is on the right
        (Preset.POSTERIOR, (1, 0, 0), (0, 0, 1)),
        (Preset.LEFT, (0, -1, 0), (0, 0, 1)),
        (Preset.RIGHT, (0, 1, 0), (0, 0, 1)),
        (Preset.SUPERIOR, (1, 0, 0), (0, 1, 0)),
        (Preset.INFERIOR, (-1, 0, 0), (0, 1, 0)),
    ],
)
def test_presets_show_their_side(preset, right, up):
    points = np.random.default_rng(3).normal([100.0, -50.0, 20.0], 30.0, size=(200, 3))
    camera = preset_camera(preset, points)
    for point in points:
        assert np.abs(seen_at(camera, point)).max() <= 1.0
    middle = camera.focal_point
    side = seen_at(camera, middle + 10.0 * np.array(right)) - seen_at(camera, middle)
    over = seen_at(camera, middle + 10.0 * np.array(up)) - seen_at(camera, middle)
    assert side[0] > 0.01 and abs(side[1]) < 1e-6
    assert over[1] > 0.01 and abs(over[0]) < 1e-6
    towards = np.cross(right, up)
    assert (camera.position - middle) @ towards > 0.0


def test_presets_follow_the_axes_of_the_patient():
    turn = posed("ras", "patient", [0.3, 1.0, 0.2], [0, 0, 0])
    points = np.random.default_rng(3).normal(scale=30.0, size=(50, 3))
    plain = preset_camera(Preset.LEFT, points)
    turned = preset_camera(Preset.LEFT, turn.apply(points), ras_from_patient=turn.rotation)
    assert np.allclose(turned.position, turn.apply(plain.position))
    assert np.allclose(turned.up, turn.rotate(plain.up))


def test_camera_node_notifies_once():
    node = vtkMRMLCameraNode()
    notified: list[int] = []
    node.AddObserver("ModifiedEvent", lambda *_: notified.append(1))
    camera = preset_camera(Preset.LEFT, np.eye(3) * 20.0)
    look_through(node, camera, 25.0)
    assert notified == [1]
    assert np.allclose(node.GetPosition(), camera.position)
    assert np.allclose(node.GetFocalPoint(), camera.focal_point)
    assert np.allclose(node.GetViewUp(), camera.up)
    assert node.GetViewAngle() == 25.0
