import numpy as np
import pytest

from app.geometry import Transform
from app.synthetic.script import PLUNGE_FROM_MM, Script

DIRECTION = np.array([0.0, 0.0, -1.0])


def pose(x, y, z):
    return Transform("tumor", "tip", np.eye(3), np.array([x, y, z], dtype=float))


def height_over_floor(tumor_from_tip):
    return float(tumor_from_tip.translation_mm[2]) - 3.0


@pytest.fixture
def plunge():
    script = Script(pose(0.0, 0.0, 40.0), height_over_floor)
    script.plunge(pose(1.0, 2.0, 4.0), DIRECTION, depth_mm=2.0, hold_s=0.3, speed_mm_s=45.0)
    return script


def test_plunge_starts_holds_and_ends_at_its_distances(plunge):
    path = plunge.path
    distances = [height_over_floor(path.at(t)) for t in np.linspace(0.0, path.end_s, 4001)]
    assert min(distances) == pytest.approx(-2.0, abs=1e-5)
    assert height_over_floor(path.at(1.5)) == pytest.approx(PLUNGE_FROM_MM, abs=1e-5)
    assert height_over_floor(path.at(path.end_s)) == pytest.approx(PLUNGE_FROM_MM, abs=1e-5)
    held = np.mean(np.array(distances) < -2.0 + 1e-6) * path.end_s
    assert held == pytest.approx(0.3, abs=0.02)


def test_plunge_crosses_the_surface_at_its_maximum_speed(plunge):
    path = plunge.path
    times = np.linspace(1.5, path.end_s, 20001)
    distances = np.array([height_over_floor(path.at(t)) for t in times])
    speed = np.gradient(distances, times)
    crossings = np.flatnonzero(np.diff(np.sign(distances)))
    np.testing.assert_allclose(np.abs(speed[crossings]), 45.0, rtol=0.01)
    assert len(crossings) == 2
    assert np.abs(speed).max() < 45.5


def test_rests_and_moves_have_their_durations():
    script = Script(pose(0.0, 0.0, 40.0), height_over_floor)
    assert script.rest(1.3) == (0.0, 1.3)
    script.move_to(pose(10.0, 0.0, 40.0), 2.0)
    assert script.rest(0.5) == pytest.approx((3.3, 3.8))
    assert script.end_s == script.path.end_s


def test_a_stroke_passes_its_poses_without_stopping():
    script = Script(pose(0.0, 0.0, 40.0), height_over_floor)
    script.stroke([pose(10.0, 0.0, 40.0), pose(20.0, 5.0, 40.0), pose(30.0, 0.0, 40.0)], 3.0)
    path, step = script.path, 1e-4
    np.testing.assert_allclose(path.at(2.0).translation_mm, (20.0, 5.0, 40.0), atol=1e-9)
    through = path.at(2.0 + step).translation_mm - path.at(2.0 - step).translation_mm
    np.testing.assert_allclose(through / (2.0 * step), (10.0, 0.0, 0.0), atol=1e-4)
    into = path.at(3.0).translation_mm - path.at(3.0 - step).translation_mm
    assert np.linalg.norm(into) / step < 0.01
