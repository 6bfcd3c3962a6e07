"""Area that a needle sweeps in the tissue, compared with areas of known sweeps."""

import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from app.analysis import insertion_metrics
from app.analysis.insertion import first_crossings, tissue_damage_mm2
from app.geometry import SurfaceMesh

RIGHT_ANGLE_DOWN = Rotation.from_rotvec([math.pi, 0.0, 0.0])


def slab() -> SurfaceMesh:
    """A block of 200 x 200 x 80 mm below z = 0, each side in many faces."""
    made = trimesh.creation.box((200.0, 200.0, 80.0)).subdivide().subdivide().subdivide()
    return SurfaceMesh("tissue", made.vertices - (0.0, 0.0, 40.0), made.faces)


def swept(tips, turns, inside=None) -> float:
    inside = np.ones(len(tips), bool) if inside is None else inside
    return tissue_damage_mm2(np.asarray(tips), turns.as_matrix(), inside, slab())


def test_parallel_translation_sweeps_depth_times_way():
    """13 mm sideways, 21.5 mm deep, in steps of different length."""
    x = np.array([0.0, 0.7, 1.0, 4.2, 9.9, 13.0])
    tips = np.stack([x, 0.2 * x, np.full_like(x, -21.5)], axis=1)
    turns = Rotation.concatenate([RIGHT_ANGLE_DOWN] * len(x))
    way = math.hypot(13.0, 0.2 * 13.0)
    assert swept(tips, turns) == pytest.approx(21.5 * way, rel=1e-12)


def test_translation_of_an_oblique_needle_sweeps_its_length_in_the_tissue():
    """Across the plane of the needle's tilt: a rectangle of its length in the tissue."""
    turn = Rotation.from_rotvec([0.0, 0.6, 0.0]) * RIGHT_ANGLE_DOWN
    y = np.linspace(-5.0, 5.0, 11)
    tips = np.stack([np.zeros(11), y, np.full(11, -12.0)], axis=1)
    length = 12.0 / math.cos(0.6)
    turns = Rotation.concatenate([turn] * 11)
    assert swept(tips, turns) == pytest.approx(10.0 * length, rel=1e-12)


def test_rotation_about_the_entry_point_sweeps_triangles_of_a_sector():
    entry, length, count = np.array([3.0, -2.0, 0.0]), 40.0, 101
    angles = np.linspace(-0.5, 0.7, count)
    turns = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]) * RIGHT_ANGLE_DOWN
    tips = entry + length * turns.apply([0.0, 0.0, 1.0])
    found = swept(tips, turns)
    steps = 0.5 * length**2 * (count - 1) * math.sin(1.2 / (count - 1))
    assert found == pytest.approx(steps, rel=1e-12)
    assert found == pytest.approx(0.5 * length**2 * 1.2, rel=1e-3)


def test_motion_along_the_axis_sweeps_nothing():
    z = np.linspace(-1.0, -60.0, 30)
    tips = np.stack([np.full(30, 5.0), np.full(30, 5.0), z], axis=1)
    assert swept(tips, Rotation.concatenate([RIGHT_ANGLE_DOWN] * 30)) == pytest.approx(
        0.0, abs=1e-9
    )


def test_steps_that_begin_or_end_outside_do_not_count():
    x = np.arange(6.0)
    z = np.array([-10.0, -10.0, 4.0, -10.0, -10.0, -10.0])
    turns = Rotation.concatenate([RIGHT_ANGLE_DOWN] * 6)
    assert swept(np.stack([x, 0.0 * x, z], axis=1), turns) == pytest.approx(30.0, rel=1e-12)
    known = np.array([True, True, True, True, False, True])
    assert swept(np.stack([x, 0.0 * x, z], axis=1), turns, known) == pytest.approx(10.0, rel=1e-12)


def test_tool_in_the_tissue_without_its_tip_sweeps_nothing():
    """The tip has left the slab below it; the shaft is still inside."""
    tips = np.array([[0.0, 0.0, -85.0], [4.0, 0.0, -85.0]])
    assert swept(tips, Rotation.concatenate([RIGHT_ANGLE_DOWN] * 2)) == 0.0


def test_first_crossings_equal_those_of_another_library():
    surface = trimesh.creation.icosphere(4, 25.0)
    surface.vertices[:, 0] *= 1.0 + 0.2 * np.sin(surface.vertices[:, 1] / 3.0)
    random = np.random.default_rng(3)
    starts = random.uniform(-30.0, 30.0, (400, 3))
    directions = random.normal(size=(400, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = first_crossings(SurfaceMesh("t", surface.vertices, surface.faces), starts, directions)
    places, rays, faces = surface.ray.intersects_location(starts, directions)
    expected, leaves = np.full(400, np.inf), np.zeros(400, bool)
    for place, ray, face in zip(places, rays, faces, strict=True):
        distance = np.linalg.norm(place - starts[ray])
        if distance < expected[ray]:
            expected[ray] = distance
            leaves[ray] = surface.face_normals[face] @ directions[ray] > 0.0
    assert 100 < np.isfinite(expected).sum() < 400
    np.testing.assert_allclose(found.distances_mm, expected, atol=1e-6)
    assert (found.leaves == leaves).all()


def test_metrics_without_rotations_have_no_damage():
    assert insertion_metrics(np.arange(3.0), np.zeros((3, 3)), slab()).tissue_damage_mm2 is None
