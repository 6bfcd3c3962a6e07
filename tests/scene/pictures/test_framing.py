import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.scene.pictures.camera_views import best_direction, fit

pytestmark = pytest.mark.slow

UP = np.array([0.0, 0.0, 1.0])
ANGLE_DEG = 30.0


@given(st.integers(0, 2**16), st.floats(0.3, 3.0), st.floats(0.1, 500.0), st.integers(1, 200))
def test_all_points_are_in_the_picture(seed, aspect, size, count):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * size + rng.normal(size=3) * 100.0
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    camera = fit(points, towards, UP, angle_deg=ANGLE_DEG, aspect=aspect)
    right = np.cross(camera.up, towards)
    offset = points - camera.position
    depth = -offset @ towards
    assert (depth > -1e-6 * size).all()
    tan = np.tan(np.radians(ANGLE_DEG / 2)) * (depth + 1e-6 * size)
    assert (np.abs(offset @ camera.up) <= tan).all()
    assert (np.abs(offset @ right) <= tan * aspect).all()


def test_points_fill_the_picture():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(500, 3)) * 40.0
    camera = fit(points, np.array([0.0, -1.0, 0.0]), UP, angle_deg=ANGLE_DEG, aspect=1.0)
    offset = points - camera.position
    tan = np.tan(np.radians(ANGLE_DEG / 2)) * (offset @ [0.0, 1.0, 0.0])
    across = np.abs(offset @ [1.0, 0.0, 0.0]) / tan
    over = np.abs(offset @ UP) / tan
    assert 0.9 < max(across.max(), over.max()) < 1.0


def ball(center, radius):
    directions = np.random.default_rng(2).normal(size=(200, 3))
    return np.array(center) + radius * directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize("side", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.7, 0.7, 0.0)])
def test_best_direction_does_not_hide_the_subject(side):
    towards = best_direction(ball((0, 0, 0), 10.0), ball(tuple(60.0 * np.array(side)), 15.0), UP)
    assert towards @ side / np.linalg.norm(side) < 0.9
    assert np.linalg.norm(towards) == pytest.approx(1.0)


def test_best_direction_shows_a_line_from_its_side():
    along = np.array([3.0, 4.0, 0.0])
    towards = best_direction(ball((0, 0, 0), 10.0), np.empty((0, 3)), UP, along)
    assert abs(towards @ along) / 5.0 < 0.2
