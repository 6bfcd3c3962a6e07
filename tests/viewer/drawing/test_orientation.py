"""Letters and scale bar, against points that VTK itself projects."""

import numpy as np
import pytest
from vtkmodules.vtkRenderingCore import vtkCamera, vtkRenderer, vtkRenderWindow

from app.viewer.drawing.camera_controller import axis_letters, camera_axes, scale_bar

pytestmark = pytest.mark.slow


def test_letters_of_a_view_from_the_front():
    axes = camera_axes(np.array([0.0, 100.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    placed = {each["letter"]: each for each in axis_letters(axes)}
    assert (placed["A"]["z"], placed["P"]["z"]) == (1.0, -1.0)
    assert (placed["S"]["y"], placed["I"]["y"]) == (-1.0, 1.0)
    # As in radiology, the patient's right is at the left of a picture from the front.
    assert (placed["R"]["x"], placed["L"]["x"]) == (-1.0, 1.0)
    assert [each["letter"] for each in axis_letters(axes)][-1] == "A"


@pytest.mark.parametrize("seed", range(5))
def test_letters_and_bar_are_where_vtk_projects_them(seed):
    random = np.random.default_rng(seed)
    position, focal, up = random.normal(size=(3, 3)) * 200.0
    camera, renderer, window = vtkCamera(), vtkRenderer(), vtkRenderWindow()
    window.SetSize(640, 480)
    window.AddRenderer(renderer)
    renderer.SetActiveCamera(camera)
    camera.SetPosition(*position)
    camera.SetFocalPoint(*focal)
    camera.SetViewUp(*up)
    camera.SetViewAngle(27.0)

    def pixel(point):
        matrix = camera.GetCompositeProjectionTransformMatrix(640 / 480, 0.0, 1.0)
        x, y, _, w = matrix.MultiplyPoint((*point, 1.0))
        return np.array([x / w * 320.0, -y / w * 240.0])

    axes = camera_axes(position, focal, up)
    for each, direction in zip(
        sorted(axis_letters(axes), key=lambda each: "RLAPSI".index(str(each["letter"]))),
        np.repeat(np.eye(3), 2, axis=0) * np.tile([1.0, -1.0], 3)[:, None],
        strict=True,
    ):
        moved = pixel(focal + 1e-3 * direction) - pixel(focal)
        shown = np.array([each["x"], each["y"]])
        assert shown / np.linalg.norm(shown) == pytest.approx(
            moved / np.linalg.norm(moved), abs=0.02
        )
    depth = float(np.linalg.norm(position - focal))
    length, pixels = scale_bar(depth, 27.0, 480)
    assert length > 0
    ends = pixel(focal + length * axes[0]) - pixel(focal)
    assert np.linalg.norm(ends) == pytest.approx(pixels, rel=1e-6)
    assert 0.05 * 480 < pixels <= 0.22 * 480


def test_no_bar_behind_the_camera_or_without_a_picture():
    assert scale_bar(-1.0, 30.0, 480) == scale_bar(10.0, 30.0, 0) == (0, 0.0)
