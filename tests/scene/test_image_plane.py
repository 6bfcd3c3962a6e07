"""Pixels of the ultrasound plane in a view: each corner of the image is at its place."""

import numpy as np
import pytest
from slicer import vtkMRMLScene

from app.scene import Camera, ImagePlane, SceneApplication, offscreen_view

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("can_draw")]

RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def test_corners_of_the_image_are_drawn_at_their_places_and_a_hidden_image_is_not():
    application = SceneApplication(vtkMRMLScene())
    parent = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", "ReferenceToRas")
    plane = ImagePlane(application.scene, parent)
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:20, :30], pixels[:20, 30:] = RED, GREEN  # first rows
    pixels[20:, :30], pixels[20:, 30:] = BLUE, WHITE
    # Columns along +x, rows along -z: seen from -y the image is upright.
    matrix = np.array([[1, 0, 0, -29.5], [0, 0, 1, 0], [0, -1, 0, 19.5], [0, 0, 0, 1]], float)
    camera = Camera(np.array([0.0, -150.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 1.0]))
    with offscreen_view(application, "Ultrasound", (200, 200)) as view:
        view.look(camera)
        empty = view.pixels()
        assert not plane.visible
        plane.show(pixels, matrix)
        drawn = view.pixels().astype(int)
        for (row, column), color in {
            (85, 80): RED, (85, 120): GREEN, (115, 80): BLUE, (115, 120): WHITE,
        }.items():  # fmt: skip
            np.testing.assert_allclose(drawn[row, column], color, atol=40)
        grey = np.full((10, 10), 128, np.uint8)
        plane.show(grey, matrix @ np.diag([6.0, 4.0, 1.0, 1.0]))
        np.testing.assert_allclose(view.pixels()[100, 100], (128,) * 3, atol=20)
        plane.hide()
        np.testing.assert_array_equal(view.pixels(), empty)
    plane.remove()
    assert application.scene.GetNumberOfNodesByClass("vtkMRMLModelNode") == 0
