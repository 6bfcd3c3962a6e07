"""The surface of clicks: against the tumour of phantom images, and what is refused in one line."""

import numpy as np
import pytest
import trimesh

from app.contour import Change, ContourEditor, contour_surface
from app.contour.surface import pixel_sigma
from app.fixture.surfaces.bvh import indexed_bvh
from app.fixture.surfaces.winding_number import dipoles_of, winding_numbers
from app.geometry import MeshError
from tests.contour.phantom import (
    PIXEL_MM,
    clicks_on,
    dice,
    is_inside,
    slice_of,
    tumor_from_image,
    tumour,
)

ME = Change("me", 0)


def clicked(count: int = 10) -> ContourEditor:
    """The clicks on seven images of the phantom, each with its place in the tumour's frame."""
    random, solid = np.random.default_rng(1), tumour()
    editor = ContourEditor("needle")
    for number, offset_mm in enumerate(np.linspace(-7.0, 7.0, 7)):
        pose = tumor_from_image(offset_mm)
        for column, row in clicks_on(slice_of(solid, pose, random), count):
            place = (pose @ [column, row, 0.0, 1.0])[:3]
            editor.add(ME, place, number, (column, row))
    return editor


def inside(mesh, points):
    return winding_numbers(dipoles_of(indexed_bvh(mesh.vertices_mm, mesh.faces)), points) > 0


@pytest.fixture(scope="module")
def editor():
    return clicked()


def test_tumour_of_clicks_has_dice_090_and_the_volume_within_10_percent(editor):
    assert 40 <= len(editor.contour.points) <= 70
    mesh = contour_surface(editor.contour, 0.0).mesh
    mesh.require_closed("the contour")
    solid = tumour()
    axis = np.arange(-14.0, 14.0, 0.5)
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    true = is_inside(solid, grid)
    assert dice(true, inside(mesh, grid)) >= 0.90
    assert mesh.signed_volume_mm3 / (true.sum() * 0.5**3) == pytest.approx(1.0, abs=0.10)


def test_surface_contains_every_click_and_dilation_adds_its_distance(editor):
    contour = editor.contour
    plain = contour_surface(contour, 0.0).mesh
    assert inside(plain, contour.positions_mm).all()
    editor.dilate(Change("me", editor.revision), 1.5)
    dilated = contour_surface(editor.contour, 0.0).mesh
    dilated.require_closed("the dilated contour")
    editor.undo(Change("me", editor.revision))
    assert editor.contour is contour
    solid = trimesh.Trimesh(plain.vertices_mm, plain.faces, process=False)
    away = np.abs(trimesh.proximity.closest_point(solid, dilated.vertices_mm[::50])[1])
    np.testing.assert_allclose(away, 1.5, atol=0.01)


def test_uncertainty_joins_calibration_pixels_and_spacing(editor):
    assert contour_surface(editor.contour, 0.0).uncertainty is None
    editor.calibrate(Change("me", editor.revision), 0.5)
    sigma_pixel = pixel_sigma((PIXEL_MM, PIXEL_MM))
    found = contour_surface(editor.contour, sigma_pixel).uncertainty
    editor.undo(Change("me", editor.revision))
    assert found.sigma_mm == pytest.approx(np.sqrt(0.5**2 + sigma_pixel**2 + found.spacing_mm**2))
    assert sigma_pixel == pytest.approx(PIXEL_MM / np.sqrt(12.0))
    few = clicked(4)
    few.calibrate(Change("me", few.revision), 0.5)
    assert contour_surface(few.contour, 0.0).uncertainty.spacing_mm > 1.5 * found.spacing_mm


def test_spacing_covers_the_error_of_a_ball(subtests):
    random = np.random.default_rng(2)
    for count in (20, 60):
        towards = random.normal(size=(count, 3))
        ball = ContourEditor("needle")
        for place in 9.0 * towards / np.linalg.norm(towards, axis=1, keepdims=True):
            ball.add(ME, place)
        ball.calibrate(Change("me", ball.revision), 0.0)
        found = contour_surface(ball.contour, 0.0)
        error = np.linalg.norm(found.mesh.vertices_mm, axis=1) - 9.0
        with subtests.test(count=count):
            assert np.sqrt(np.mean(error**2)) <= found.uncertainty.spacing_mm <= 1.5


def refusal(editor: ContourEditor) -> str:
    with pytest.raises(MeshError) as error:
        contour_surface(editor.contour, 0.0)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_few_points_and_points_in_one_plane_are_refused():
    editor = ContourEditor("needle")
    editor.add(ME, (0.0, 0.0, 0.0))
    editor.add(ME, (9.0, 0.0, 0.0))
    assert refusal(editor) == ("contour: 2 points; expected 4 or more that are not in one plane")
    for place in ((9.0, 9.0, 0.0), (0.0, 9.0, 0.0), (4.0, 11.0, 0.0)):
        editor.add(ME, place)
    assert "nearly in one plane" in refusal(editor)


def test_outline_that_crosses_itself_is_refused_with_its_points():
    editor = ContourEditor("needle")
    for column, row in ((0, 0), (10, 0), (10, 10), (0, 10)):
        editor.add(ME, (column, row, 0.0), 3, (column, row))
    editor.add(ME, (5.0, 5.0, 6.0))
    assert contour_surface(editor.contour, 0.0).mesh.signed_volume_mm3 > 100.0
    editor.move(Change("me", editor.revision), 2, (-5.0, 8.0, 0.0), (-5, 8))
    assert refusal(editor) == (
        "contour in image 3: crosses itself between points 2 and 3 and points 4 and 1; expected "
        "a simple outline (drag or erase one of these points)"
    )
    editor.move(Change("me", editor.revision), 2, (10.0, 0.0, 0.0), (10, 0))
    assert contour_surface(editor.contour, 0.0).mesh.signed_volume_mm3 > 100.0


def test_dilation_out_of_range_is_refused():
    editor = ContourEditor("needle")
    editor.dilate(Change("me", editor.revision), 20.5)
    assert refusal(editor) == "dilation of the contour: is 20.5 mm; expected 0 to 20 mm"
