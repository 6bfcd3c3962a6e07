"""Cuts of a volume through the tip, against the function that made the volume."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.files.volume_file import Volume
from app.geometry import Transform
from app.viewer.image_cuts import PIXEL_MM, SIDE, Reslice, ReslicePlane, edges, plane_matrix

pytestmark = pytest.mark.slow

BREACH = 20
AXIS = np.array([0.0, 0.0, -1.0])
TIP = Transform(
    "tumor", "tip", Rotation.from_euler("xyz", [30, 20, 10], True).as_matrix(), [4.0, -3.0, 6.0]
)


def linear_volume():
    """Values 2 r + 3 a + 5 s at the place (r, a, s) in mm, in 160 mm around the origin."""
    axes = [np.arange(81) * 2.0 - 80.0] * 3
    r, a, s = np.meshgrid(*axes, indexing="ij")
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    matrix[:3, 3] = -80.0
    return Volume((2 * r + 3 * a + 5 * s).astype(np.float32), matrix)


@pytest.mark.parametrize("plane", ReslicePlane)
def test_pixels_are_the_values_at_their_places(plane):
    matrix = plane_matrix(plane, TIP, AXIS)
    found = Reslice(linear_volume()).pixels(matrix)
    for column, row in [(0, 0), (SIDE - 1, 0), (100, 250), (SIDE - 1, SIDE - 1)]:
        place = (matrix @ [column, row, 0, 1])[:3]
        assert found[row, column] == pytest.approx(place @ [2, 3, 5], abs=1e-3)


def directions(plane):
    """Unit directions of columns and rows."""
    matrix = plane_matrix(plane, TIP, AXIS)
    return matrix[:3, 0] / PIXEL_MM, matrix[:3, 1] / PIXEL_MM


def test_anatomical_planes_are_seen_as_in_slicer():
    left, back, down = [-1, 0, 0], [0, -1, 0], [0, 0, -1]
    np.testing.assert_allclose(directions(ReslicePlane.AXIAL), [left, back])
    np.testing.assert_allclose(directions(ReslicePlane.SAGITTAL), [back, down])
    np.testing.assert_allclose(directions(ReslicePlane.CORONAL), [left, down])
    shown = {plane: edges(plane_matrix(plane, TIP, AXIS)) for plane in ReslicePlane}
    assert shown[ReslicePlane.AXIAL] == "RLAP"
    assert shown[ReslicePlane.SAGITTAL] == "APSI"
    assert shown[ReslicePlane.CORONAL] == "RLSI"


@pytest.mark.parametrize("turn", [[0, 0, 0], [30, 20, 10], [0, 90, 0]])
def test_plane_along_the_tool_contains_its_axis(turn):
    tip = replace(TIP, rotation=Rotation.from_euler("xyz", turn, True).as_matrix())
    matrix = plane_matrix(ReslicePlane.TOOL, tip, AXIS)
    axis = tip.rotation @ AXIS
    np.testing.assert_allclose(matrix[:3, 1], PIXEL_MM * axis, atol=1e-12)
    gram = matrix[:3, :2].T @ matrix[:3, :2]
    np.testing.assert_allclose(gram, PIXEL_MM**2 * np.eye(2), atol=1e-12)
    middle = matrix @ [(SIDE - 1) / 2, (SIDE - 1) / 2, 0, 1]
    np.testing.assert_allclose(middle[:3], tip.translation_mm, atol=1e-12)


def test_cut_of_a_step_has_its_outlines_and_the_tip_in_the_middle(parts):
    reslice = Reslice(linear_volume())
    view = reslice.at(parts.feed.shown[BREACH], "needle", ReslicePlane.SAGITTAL)
    assert view.problem == "" and view.image is not None and view.tip is not None
    np.testing.assert_allclose(view.tip, [(SIDE - 1) / 2, (SIDE - 1) / 2, 0.0], atol=1e-6)
    # The sagittal plane through the tip, which is 30 mm below, cuts the ball of 8 mm in a circle.
    tip = parts.feed.shown[BREACH].step.tumor_from_tip
    radius = np.sqrt(64.0 - tip.translation_mm[0] ** 2)
    (outline,) = view.tumor
    middle = (SIDE - 1) / 2 + tip.translation_mm[1:] / PIXEL_MM
    away = PIXEL_MM * np.linalg.norm(outline - middle, axis=1)
    assert np.abs(away - radius).max() < 0.1
    same = reslice.at(parts.feed.shown[BREACH], "needle", ReslicePlane.SAGITTAL)
    other = reslice.at(parts.feed.shown[BREACH], "needle", ReslicePlane.CORONAL)
    assert same.number == view.number != other.number


def test_no_cut_is_shown_while_the_place_of_the_tool_is_not_known(parts):
    reslice = Reslice(linear_volume())
    shown = parts.feed.shown[BREACH]
    unknown = replace(shown.as_unknown("no tool"), silent="")
    for state, root in ((unknown, "needle"), (None, "needle"), (shown, None)):
        view = reslice.at(state, root, ReslicePlane.TOOL)
        assert view.problem and view.image is None and view.tumor == ()
    assert reslice.at(shown.as_unknown("ended"), "needle", ReslicePlane.TOOL).problem == "ended"
