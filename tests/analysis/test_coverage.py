"""Coverage against a count of all pairs of points, and against a ball that passes a ball."""

import tracemalloc

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from app.analysis import CaseSamples, coverage_of
from app.analysis.coverage import MAX_PLACES, SPACING_MM, WITHIN_MM, surface_points
from app.geometry import SurfaceMesh
from tests.analysis.case_samples import mesh, samples

pytestmark = pytest.mark.slow


TUMOR = mesh(trimesh.creation.icosphere(3, radius=8.0), "tumor")
TOOL = mesh(trimesh.creation.box([2.0, 3.0, 6.0]), "tip")


def test_coverage_equals_the_distance_to_the_tool_in_every_frame():
    random = np.random.default_rng(1)
    tips = np.cumsum(random.normal(0.0, 1.0, (30, 3)), axis=0) + np.array([11.0, 0.0, 0.0])
    turned = Rotation.random(30, random_state=1).as_matrix()
    found = coverage_of(samples(tips, turned), TUMOR, TOOL)
    box = trimesh.Trimesh(TOOL.vertices_mm, TOOL.faces)
    centres = found.places_mm
    brute = np.full(len(centres), np.inf)
    for tip, rotation in zip(tips, turned, strict=True):
        _, distance, _ = trimesh.proximity.closest_point(box, (centres - tip) @ rotation)
        brute = np.minimum(brute, distance)
    near = np.isfinite(found.nearest_mm)
    assert (near != (brute < max(WITHIN_MM))).sum() < 3
    excess = found.nearest_mm[near] - brute[near]
    assert excess.min() > -1e-6
    assert np.all(excess**2 + 2.0 * excess * brute[near] <= SPACING_MM**2 + 1e-6)
    for within in (2.0, 5.0):
        share = found.areas_mm2[brute <= within].sum() / found.areas_mm2.sum()
        assert found.share(within) == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("order", ["as made", "every n-th on one side"])
def test_share_of_a_fine_surface_does_not_depend_on_the_order_of_its_faces(order):
    """A cap of a ball of 20480 faces, of which every n-th one may follow a pattern of the mesh."""
    fine = mesh(trimesh.creation.icosphere(5, radius=8.0), "tumor")
    if order == "every n-th on one side":
        upwards = np.argsort(fine.triangles_mm.mean(axis=1)[:, 2])
        places = np.argsort(np.arange(len(upwards)) % -(-len(upwards) // MAX_PLACES), kind="stable")
        faces = np.empty_like(fine.faces)
        faces[places] = fine.faces[upwards]
        fine = SurfaceMesh("tumor", fine.vertices_mm, faces)
    for away in (8.5, 10.0, 12.0):
        tip = np.array([[0.6, 0.0, 0.8]]) * away
        found = coverage_of(samples(tip), fine, None)
        assert len(found.faces) <= MAX_PLACES < len(fine.faces)
        cosine = (away**2 + 8.0**2 - 5.0**2) / (2.0 * away * 8.0)
        assert found.share(5.0) == pytest.approx(0.5 * (1.0 - cosine), abs=0.006)


def test_tip_alone_covers_a_cap():
    """Points of a sphere of radius R within x of a point at distance a from its centre."""
    found = coverage_of(samples(np.array([[10.0, 0.0, 0.0]])), TUMOR, None)
    cosine = (8.0**2 + 10.0**2 - 5.0**2) / (2.0 * 8.0 * 10.0)
    assert found.share(5.0) == pytest.approx(0.5 * (1.0 - cosine), abs=0.01)
    assert found.share(1.0) == 0.0


def test_frames_without_a_pose_cover_nothing():
    found = coverage_of(samples(np.full((3, 3), np.nan)), TUMOR, TOOL)
    assert (found.frames, found.share(10.0)) == (0, 0.0)


def test_points_of_a_surface_are_dense():
    points = surface_points(TOOL, 0.5)
    box = trimesh.Trimesh(TOOL.vertices_mm, TOOL.faces)
    assert np.abs(trimesh.proximity.signed_distance(box, points)).max() < 1e-5
    random, _ = trimesh.sample.sample_surface(box, 500, seed=1)
    nearest = np.linalg.norm(random[:, None] - points[None], axis=2).min(axis=1)
    assert nearest.max() <= 0.5


@pytest.mark.parametrize(
    "shape",
    [
        trimesh.creation.box([16.0, 16.0, 16.0]),
        trimesh.creation.icosphere(0, radius=8.0),
        trimesh.creation.cylinder(6.0, 30.0, sections=12),
        trimesh.creation.icosphere(6, radius=8.0),
    ],
    ids=["12 faces", "20 faces", "36 uneven faces", "81920 faces"],
)
def test_share_of_a_coarse_surface_is_that_of_its_area(shape):
    """Compared with 40 thousand points that are random on the surface."""
    random = np.random.default_rng(8)
    tips = random.uniform(-7.0, 7.0, (12, 3)) + np.array([6.0, 0.0, 3.0])
    found = coverage_of(samples(tips), mesh(shape), None)
    points, _ = trimesh.sample.sample_surface(shape, 40_000, seed=5)
    nearest = np.linalg.norm(points[:, None] - tips[None], axis=2).min(axis=1)
    for within in WITHIN_MM:
        assert found.share(within) == pytest.approx((nearest <= within).mean(), abs=0.015)


def hand(count: int, seed: int) -> CaseSamples:
    """A tool that jitters much around the tumour, some mm from its surface."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)
    towards = np.stack([np.cos(200.0 * t), np.sin(200.0 * t), np.sin(9.0 * t)], axis=1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    tips = (12.0 + 0.5 * np.sin(70.0 * t))[:, None] * towards + random.normal(0.0, 0.6, (count, 3))
    return samples(tips, Rotation.from_rotvec(0.3 * towards).as_matrix())


def test_parts_of_the_work_have_the_same_result_as_all_at_once(monkeypatch):
    poses = hand(200, 3)
    whole = coverage_of(poses, TUMOR, TOOL).nearest_mm
    monkeypatch.setattr("app.analysis.coverage._AT_ONCE", 37)
    np.testing.assert_array_equal(coverage_of(poses, TUMOR, TOOL).nearest_mm, whole)


def test_memory_does_not_grow_with_the_number_of_poses_times_faces():
    """10 thousand poses and 1280 faces: 13 million pairs, 100 MB of distances."""
    poses = hand(10_000, 4)
    coverage_of(hand(100, 4), TUMOR, TOOL)
    tracemalloc.start()
    coverage_of(poses, TUMOR, TOOL)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 60e6
