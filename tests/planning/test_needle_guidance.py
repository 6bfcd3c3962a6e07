"""Guidance along a corridor, against linear algebra of its own, and bad poses."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import FrameError, InputError, Transform
from app.planning import NeedlePath, guide_needle

PATH = NeedlePath("ct", [10.0, -5.0, 80.0], [30.0, 12.0, 5.0])


def facing(path, tilt_rad, rng):
    """A random rotation whose z axis is ``tilt_rad`` from the path's."""
    way = path.target_mm - path.entry_mm
    side = np.cross(way, rng.normal(size=3))
    tilted = Rotation.from_rotvec(tilt_rad * side / np.linalg.norm(side)).apply(way)
    turn, _ = Rotation.align_vectors([tilted], [[0.0, 0.0, 1.0]])
    return (turn * Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 6.0)])).as_matrix()


def meeting(point, normal, start, way):
    """Where the line ``start + s way`` meets a plane, by solving for the point and s together."""
    basis = np.linalg.svd(normal[None])[2][1:]
    at = np.linalg.solve(np.column_stack([way, -basis.T]), point - start)
    return start + at[0] * way


@pytest.mark.parametrize("seed", range(20))
def test_guidance_is_that_of_lines_and_planes(seed):
    rng = np.random.default_rng(seed)
    path = NeedlePath("ct", *rng.normal(scale=50.0, size=(2, 3)))
    tilt_rad = rng.uniform(0.0, math.radians(59.0))
    rotation = facing(path, tilt_rad, rng)
    tip = path.entry_mm + rng.uniform(-0.2, 1.2) * (path.target_mm - path.entry_mm)
    tip = tip + rng.normal(scale=8.0, size=3)
    found = guide_needle(path, Transform("ct", "needle", rotation, tip))
    way = (path.target_mm - path.entry_mm) / path.depth_mm
    parts, *_ = np.linalg.lstsq(way[:, None], tip - path.entry_mm, rcond=None)
    foot = path.entry_mm + parts[0] * way
    assert found.lateral_mm == pytest.approx(np.linalg.norm(tip - foot), abs=1e-9)
    assert found.angle_rad == pytest.approx(tilt_rad, abs=1e-7)
    assert found.remaining_mm == pytest.approx((path.target_mm - foot) @ way, abs=1e-9)
    arrival = meeting(path.target_mm, way, tip, rotation[:, 2])
    assert found.miss_mm == pytest.approx(np.linalg.norm(arrival - path.target_mm), abs=1e-8)
    crossing = meeting(path.entry_mm, way, tip, rotation[:, 2])
    shown = path.frame_from_path.apply(np.append(found.crosshair_mm, 0.0))
    assert shown == pytest.approx(crossing, abs=1e-8)


def test_guidance_is_the_same_in_another_frame():
    rng = np.random.default_rng(3)
    other = Transform("tumor", "ct", Rotation.random(random_state=rng).as_matrix(), [5, 60, -7])
    needle = Transform("ct", "needle", facing(PATH, 0.2, rng), np.add(PATH.entry_mm, 2.0))
    here, there = guide_needle(PATH, needle), guide_needle(PATH.in_frame(other), other @ needle)
    for name in ("lateral_mm", "angle_rad", "remaining_mm", "miss_mm"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-9)


def test_path_is_between_entry_and_target():
    assert PATH.frame_from_path.apply([0, 0, 0]) == pytest.approx(PATH.entry_mm)
    assert PATH.frame_from_path.apply([0, 0, PATH.depth_mm]) == pytest.approx(PATH.target_mm)


def test_target_is_near_up_to_the_window_and_not_if_its_place_is_unknown():
    assert PATH.is_target_near(np.add(PATH.target_mm, [0.0, 0.6, 0.8]), 1.0 + 1e-9)
    assert not PATH.is_target_near(np.add(PATH.target_mm, [0.0, 0.6, 0.8]), 0.99)
    assert not PATH.is_target_near(None, 1000.0)


def needle_at(rotation, tip_mm):
    return Transform.unchecked("ct", "needle", np.array(rotation, float), np.array(tip_mm, float))


REFUSED = {
    "tip that is not finite": lambda: guide_needle(PATH, needle_at(np.eye(3), [0, math.nan, 0])),
    "axis that is not finite": lambda: guide_needle(PATH, needle_at(np.eye(3) * math.nan, [0] * 3)),
    "axis of length 0": lambda: guide_needle(PATH, needle_at(np.zeros((3, 3)), [0] * 3)),
    "axis of length 2": lambda: guide_needle(PATH, needle_at(2 * np.eye(3), [0] * 3)),
    "needle that points back": lambda: guide_needle(PATH, needle_at(np.eye(3), [0, 0, 0])),
    "path without length": lambda: NeedlePath("ct", [1, 2, 3], [1, 2, 3]),
    "entry that is not finite": lambda: NeedlePath("ct", [1, 2, math.inf], [1, 2, 3]),
    "target of two numbers": lambda: NeedlePath("ct", [1, 2, 3], [1, 2]),
    "place that is not finite": lambda: PATH.is_target_near([0, 0, math.nan], 1.0),
    "window that is not finite": lambda: PATH.is_target_near(None, math.nan),
    "negative window": lambda: PATH.is_target_near([0, 0, 0], -1.0),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_value_is_refused_in_one_line(name):
    with pytest.raises(InputError, match=r"^[^:]+: .+; expected .+$"):
        REFUSED[name]()


def test_pose_in_another_frame_is_refused():
    with pytest.raises(FrameError, match="needle: is in 'ras'; expected 'ct' as the path"):
        guide_needle(PATH, Transform.identity("ras", "needle"))
    with pytest.raises(FrameError, match="is from 'ras'; expected from 'ct'"):
        PATH.in_frame(Transform.identity("tumor", "ras"))
