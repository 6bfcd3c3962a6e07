"""Swept volume against capsules and CGAL's booleans; the specimen against known shapes."""

import math

import manifold3d
import numpy as np
import pytest
import trimesh
from igl.copyleft import cgal
from scipy.spatial.transform import Rotation

from app.analysis import coverage_of
from app.analysis.coverage import side_results, sides_of_surface
from app.analysis.specimen import resection_of, specimen_of
from app.analysis.swept_volume import MAX_POINTS, MAX_STEPS, cutting_points, solid_of, swept_volume
from app.geometry import InputError, MeshError, SurfaceMesh
from tests.analysis.case_samples import mesh, samples

pytestmark = pytest.mark.long

STALE_NS = 100_000_000
RADIUS_MM = 1.5


def ball_points(segments: int) -> np.ndarray:
    ball = manifold3d.Manifold.sphere(RADIUS_MM, segments).to_mesh64()
    return np.array(ball.vert_properties[:, :3])


def unturned(count: int) -> np.ndarray:
    return np.tile(np.eye(3), (count, 1, 1))


@pytest.mark.parametrize("poses", [2, 30, 400])
def test_straight_sweep_of_a_ball_is_a_capsule(poses):
    along = np.linspace(0.0, 10.0, poses)[:, None] * np.array([0.6, 0.0, 0.8])
    found = swept_volume(ball_points(128), [(along, unturned(poses))])
    capsule = math.pi * RADIUS_MM**2 * (10.0 + 4.0 / 3.0 * RADIUS_MM)
    assert found.volume_mm3 == pytest.approx(capsule, rel=0.005)
    assert (found.poses, found.hulls) == (poses, 1)


@pytest.mark.parametrize("radius", [0.8, 2.5])
@pytest.mark.parametrize("direction", [(0.3, -0.7, 0.5), (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)])
def test_capsule_of_a_tool_with_many_faces_has_its_volume(radius, direction):
    """A ball of 2562 corners, of which the cutting part keeps 144 at most; it turns, too."""
    ball = mesh(trimesh.creation.icosphere(4, radius), "tip")
    points = cutting_points(ball, 10.0)
    assert len(points) <= MAX_POINTS
    along = np.linspace(0.0, 17.3, 120)[:, None] * np.array(direction) / np.linalg.norm(direction)
    turns = Rotation.from_rotvec(np.linspace(0.0, 2.0, 120)[:, None] * [0.3, 0.2, 0.9])
    capsule = math.pi * radius**2 * (17.3 + 4.0 / 3.0 * radius)
    straight = swept_volume(points, [(along, unturned(120))])
    assert straight.volume_mm3 == pytest.approx(capsule, rel=0.005)
    turning = swept_volume(points, [(along, turns.as_matrix())])
    assert turning.volume_mm3 == pytest.approx(capsule, rel=0.005)


def test_fewer_corners_keep_the_extent_of_a_long_tool():
    """A rod of 10 mm with a round end: its sweep to the side is its section times the way."""
    rod = trimesh.creation.capsule(30.0, 1.2, count=[64, 64])
    rod.apply_translation((0.0, 0.0, -rod.bounds[1][2]))
    points = cutting_points(mesh(rod, "tip"), 10.0)
    assert 80 < len(points) <= MAX_POINTS
    assert points[:, 2].min() == pytest.approx(-10.0, abs=0.15)
    assert points[:, 2].max() == pytest.approx(0.0, abs=0.15)
    tips = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    found = swept_volume(points, [(tips, unturned(2))])
    near = solid_of(mesh(rod, "tip")) ^ manifold3d.Manifold.sphere(10.0, 128)
    section = near.rotate((0.0, 90.0, 0.0)).project().area()
    assert found.volume_mm3 == pytest.approx(near.volume() + 20.0 * section, rel=0.01)


def test_nothing_is_swept_between_two_pieces():
    tips = np.array([[0.0, 0, 0], [5.0, 0, 0], [50.0, 0, 0], [55.0, 0, 0]])
    pieces = [(tips[:2], unturned(2)), (tips[2:], unturned(2))]
    found = swept_volume(ball_points(128), pieces)
    capsule = math.pi * RADIUS_MM**2 * (5.0 + 4.0 / 3.0 * RADIUS_MM)
    assert found.volume_mm3 == pytest.approx(2.0 * capsule, rel=0.005)


def test_turning_sweep_equals_the_union_by_cgal():
    """Exact booleans of libigl on the same poses, without the union of manifold3d."""
    random = np.random.default_rng(4)
    points = trimesh.creation.box([2.0, 0.8, 6.0]).vertices
    tips = np.cumsum(random.normal(0.0, 2.0, (6, 3)), axis=0)
    rotations = Rotation.random(6, random_state=2).as_matrix()
    found = swept_volume(points, [(tips, rotations)])
    assert found.hulls == 5
    corners = np.einsum("kj,nij->nki", points, rotations) + tips[:, None]
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    for step in range(5):
        hull = trimesh.convex.convex_hull(corners[step : step + 2].reshape(-1, 3))
        other = np.asarray(hull.vertices), np.asarray(hull.faces, dtype=np.int64)
        vertices, faces = cgal.mesh_boolean(vertices, faces, *other, "union")[:2]
    expected = SurfaceMesh("tumor", vertices, faces).signed_volume_mm3
    assert found.volume_mm3 == pytest.approx(expected, rel=1e-6)


def test_steps_are_left_out_within_the_stated_error():
    """A ball on a circle: each kept step cuts off at most the sagitta that is stated."""
    angle = np.linspace(0.0, 2.0 * math.pi, 3000)
    tips = 20.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    torus = 2.0 * math.pi**2 * 20.0 * RADIUS_MM**2
    found = swept_volume(ball_points(32), [(tips, unturned(3000))], max_steps=60)
    assert found.hulls < 80
    assert found.tolerance_mm <= 0.2
    assert found.volume_mm3 == pytest.approx(torus, rel=0.02)


def test_cutting_part_is_the_end_of_the_tool():
    rod = trimesh.creation.box([2.0, 2.0, 40.0])
    points = cutting_points(mesh(rod, "tip", (0.0, 0.0, -20.0)), 6.0)
    assert points[:, 2].min() == pytest.approx(-6.0, abs=0.05)
    assert points[:, 2].max() == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(MeshError, match="no part of the tool is within"):
        cutting_points(mesh(rod, "tip", (0.0, 0.0, -50.0)), 6.0)
    with pytest.raises(InputError, match="expected more than 0"):
        cutting_points(mesh(rod, "tip"), -1.0)


def test_margins_of_a_shell_around_a_ball():
    """A ball of 5 mm, 1 mm to the right of the middle of a cavity of 9 mm."""
    sphere = manifold3d.Manifold.sphere
    shell = sphere(11.0, 96) - sphere(9.0, 96)
    tumor = mesh(trimesh.creation.icosphere(4, radius=5.0), at=(1.0, 0.0, 0.0))
    found = specimen_of(shell, solid_of(tumor), tumor)
    assert found.volume_mm3 == pytest.approx(4.0 / 3.0 * math.pi * 9.0**3, rel=0.01)
    assert found.tumor_outside_mm3 == pytest.approx(0.0, abs=1e-6)
    assert found.closest == "R"
    assert found.margins_mm["R"] == pytest.approx(3.0, abs=0.05)
    far_edge = 9.0 - math.hypot(5.0 / math.sqrt(3.0) - 1.0, 5.0 * math.sqrt(2.0 / 3.0))
    assert found.margins_mm["L"] == pytest.approx(far_edge, abs=0.1)
    turned = specimen_of(shell, solid_of(tumor), tumor, np.diag([-1.0, -1.0, 1.0]))
    assert turned.closest == "L"


def test_specimen_has_the_cavities_of_the_sweep_and_is_the_innermost_part():
    sphere = manifold3d.Manifold.sphere
    shells = sphere(14.0, 64) - sphere(12.0, 64) + (sphere(10.0, 64) - sphere(9.0, 64))
    burn = sphere(1.0, 64).translate([0.0, 0.0, 7.0])
    tumor = mesh(trimesh.creation.icosphere(3, radius=5.0))
    found = specimen_of(shells + burn, solid_of(tumor), tumor)
    assert found.volume_mm3 == pytest.approx(4.0 / 3.0 * math.pi * (9.0**3 - 1.0), rel=0.01)
    assert found.closest == "S"
    assert found.margins_mm["S"] == pytest.approx(1.0, abs=0.1)


def test_tumor_that_was_cut_has_a_negative_margin():
    sphere = manifold3d.Manifold.sphere
    shell = sphere(11.0, 96) - sphere(9.0, 96)
    tumor = mesh(trimesh.creation.icosphere(4, radius=5.0), at=(0.0, 0.0, 5.0))
    found = specimen_of(shell, solid_of(tumor), tumor)
    assert found.closest == "S"
    assert found.margins_mm["S"] == pytest.approx(-1.0, abs=0.05)
    d, big, small = 5.0, 9.0, 5.0
    lens = math.pi * (big + small - d) ** 2
    lens *= d**2 + 2 * d * (big + small) - 3 * (big - small) ** 2
    outside = 4.0 / 3.0 * math.pi * small**3 - lens / (12 * d)
    assert found.tumor_outside_mm3 == pytest.approx(outside, rel=0.06)


def spiral(turns: float, gap: bool) -> np.ndarray:
    """Path of a tip on a sphere of 8 mm; with ``gap`` it stops below the upper pole."""
    polar = np.linspace(math.pi, 0.6 if gap else 0.0, 900)
    around = 2.0 * math.pi * turns * polar / math.pi
    across = np.stack([np.cos(around), np.sin(around)], axis=1) * np.sin(polar)[:, None]
    return 8.0 * np.column_stack([across, np.cos(polar)])


def test_spiral_cut_separates_a_specimen_only_without_a_gap():
    tumor = mesh(trimesh.creation.icosphere(3, radius=4.0))
    tool = mesh(trimesh.creation.icosphere(3, radius=RADIUS_MM), "tip")
    closed = resection_of(samples(spiral(14.0, False)), tumor, tool, stale_after_ns=STALE_NS)
    assert closed.why == ""
    assert closed.swept.hulls <= MAX_STEPS
    inner = 8.0 - RADIUS_MM
    assert closed.specimen.margins_mm == pytest.approx(
        dict.fromkeys("RLAPSI", inner - 4.0), abs=0.4
    )
    ball = 4.0 / 3.0 * math.pi * inner**3
    assert ball * 0.98 < closed.specimen.volume_mm3 < ball * 1.3
    gap = resection_of(samples(spiral(14.0, True)), tumor, tool, stale_after_ns=STALE_NS)
    assert gap.specimen is None
    assert gap.as_dict()["no_specimen"] == "the swept volume does not enclose the tumour"
    assert gap.swept.volume_mm3 < closed.swept.volume_mm3


def test_loss_of_the_tracker_leaves_a_gap_in_the_sweep():
    tumor = mesh(trimesh.creation.icosphere(3, radius=4.0))
    tool = mesh(trimesh.creation.icosphere(2, radius=RADIUS_MM), "tip")
    path = np.delete(spiral(14.0, False), np.arange(400, 500), axis=0)
    found = resection_of(samples(path, gap_at=400), tumor, tool, stale_after_ns=STALE_NS)
    assert found.specimen is None


def test_case_without_a_tool_mesh_or_a_pose_has_no_sweep():
    tumor = mesh(trimesh.creation.icosphere(2, radius=4.0))
    tool = mesh(trimesh.creation.icosphere(2, radius=RADIUS_MM), "tip")
    path = spiral(14.0, False)
    assert "its tip alone" in resection_of(samples(path), tumor, None, stale_after_ns=1).why
    open_tool = SurfaceMesh("tip", tool.vertices_mm, tool.faces[1:])
    assert "closed" in resection_of(samples(path), tumor, open_tool, stale_after_ns=STALE_NS).why
    lost = samples(np.full((5, 3), np.nan))
    found = resection_of(lost, tumor, tool, stale_after_ns=STALE_NS)
    assert (found.swept, found.specimen) == (None, None)
    assert "never within" in found.why


def test_area_of_the_sides_is_that_of_the_whole_surface_also_if_coverage_uses_a_part():
    tumor = mesh(trimesh.creation.icosphere(5, radius=4.0))
    coverage = coverage_of(samples(spiral(3.0, False)[::100]), tumor, None)
    assert len(coverage.faces) < len(tumor.faces)
    sides = side_results(tumor, coverage, (), {"R": 2.5})
    assert sum(side.area_mm2 for side in sides) == pytest.approx(tumor_area(tumor))
    assert [side.margin_mm for side in sides] == [2.5, *[None] * 5]
    for within, share in coverage.shares().items():
        key = f"within_{within:g}_mm"
        total = sum(side.area_mm2 * side.shares[key] for side in sides) / tumor_area(tumor)
        assert total == pytest.approx(share, abs=0.02)


def tumor_area(tumor: SurfaceMesh) -> float:
    return float(trimesh.Trimesh(tumor.vertices_mm, tumor.faces).area)


def test_sides_are_those_of_the_largest_component():
    tumor = mesh(trimesh.creation.box([2.0, 2.0, 2.0]), at=(5.0, 0.0, 0.0))
    sides = sides_of_surface(tumor)
    normals = np.cross(*np.diff(tumor.triangles_mm, axis=1).transpose(1, 0, 2))
    letters = {"R": 0, "L": 0, "A": 1, "P": 1, "S": 2, "I": 2}
    for side, normal in zip(sides, normals, strict=True):
        assert np.argmax(np.abs(normal)) == letters[side]
        assert (normal[letters[side]] > 0.0) == (side in "RAS")
