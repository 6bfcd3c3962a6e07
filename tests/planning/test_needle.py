"""Needle corridors: what is offered, the map, the robot, and bad input."""

import math

import igl
import numpy as np
import pytest
import trimesh

from app.geometry import FrameError, InputError, MeshError, SurfaceMesh, Transform
from app.planning import (
    EntryRegion,
    ForbiddenStructure,
    Needle,
    NeedleRobot,
    NeedleTarget,
    NoCorridorError,
    plan_needle,
)
from app.planning.corridor_distance import DEPTH_TOLERANCE_MM, closed_surface, needle_distances
from app.planning.needle import DISTINCT_MM
from app.planning.needle_values import MAX_ANGLE_RAD
from app.robot import load_robot
from tests.planning.needle_scenes import check_scenes

pytestmark = pytest.mark.slow

FRAME = "patient"
NEEDLE = Needle(length_mm=100.0, diameter_mm=1.0, bend_mm=2.0)
REGION = EntryRegion.of_disc(FRAME, [0, 0, 60], [0, 0, 1], 40.0, count=2000)
TARGET = NeedleTarget.of_points(FRAME, [[0.0, 0.0, 0.0]])


def ball(center, radius, frame=FRAME):
    shape = trimesh.creation.icosphere(3, radius)
    return SurfaceMesh(frame, shape.vertices + center, shape.faces)


def forbidden(name, center, radius, stop_mm=1.0, sigma_mm=0.0):
    return ForbiddenStructure(name, ball(center, radius), stop_mm, sigma_mm)


def plan(structures=(), region=REGION, target=TARGET, needle=NEEDLE, robot=None, **values):
    given = {"error": 0.5, "k_sigma": 2.0} | values
    return plan_needle(region, target, needle, structures, robot=robot, **given)


def test_without_structures_the_best_corridor_is_the_shortest():
    best = plan().best
    assert best.depth_mm == pytest.approx(60.0, abs=0.1)
    assert best.angle_rad == pytest.approx(0.0, abs=math.radians(2.0))
    assert best.structures == ()


def test_corridor_flatter_than_the_largest_angle_is_not_allowed():
    angles = MAX_ANGLE_RAD + np.radians([-1.0, 1.0])
    normals = np.column_stack([np.zeros(2), np.sin(angles), np.cos(angles)])
    found = plan(region=EntryRegion(FRAME, [[0.0, 0.0, 60.0]] * 2, normals))
    assert np.isfinite(found.scores).tolist() == [True, False]


def test_structure_in_the_middle_is_passed_at_the_required_distance():
    found = plan([forbidden("vessel", [0, 0, 30], 8.0, sigma_mm=1.0)])
    for each in found.corridors:
        (distance,) = each.structures
        assert distance.required_mm == pytest.approx(1.0 + 2.0 * math.hypot(0.5, 1.0))
        assert distance.clearance_mm >= distance.required_mm
        # Beyond two standard deviations and the stop margin.
        assert distance.hit_probability < 0.01
        assert each.score == pytest.approx(np.nanmax(found.scores), abs=0.2)
    assert found.best.score == pytest.approx(np.nanmax(found.scores))
    assert found.blocked_by()["vessel"] > 0


def test_corridors_are_distinct_and_in_the_order_of_their_scores():
    found = plan([forbidden("vessel", [0, 0, 30], 8.0)])
    entries = np.array([each.entry_mm for each in found.corridors])
    gaps = np.linalg.norm(entries[:, None] - entries[None], axis=2)[np.triu_indices(4, 1)]
    assert len(entries) == 4
    assert gaps.min() >= DISTINCT_MM
    scores = [each.score for each in found.corridors]
    assert scores == sorted(scores, reverse=True)


def test_needle_that_bends_keeps_farther_away():
    vessel = [forbidden("vessel", [0, 0, 30], 8.0)]
    straight = plan(vessel, needle=Needle(100.0, 1.0, 0.0))
    bent = plan(vessel, needle=Needle(100.0, 1.0, 10.0))
    assert np.isfinite(bent.scores).sum() < np.isfinite(straight.scores).sum()
    assert not (np.isfinite(bent.scores) & np.isnan(straight.scores)).any()


def test_target_inside_a_forbidden_structure_is_never_reached():
    with pytest.raises(
        NoCorridorError, match=r"^corridor: none of 2000 entries .*cage blocks 2000"
    ):
        plan([forbidden("cage", [0, 0, 0], 20.0), forbidden("vessel", [0, 0, 30], 8.0)])


def test_centre_of_a_structure_is_preferred_and_a_corridor_to_another_point_is_found():
    target = NeedleTarget.of_structure(ball([0, 0, 0], 9.0))
    assert target.centrality[0] == pytest.approx(1.0, abs=0.01)
    assert (np.linalg.norm(target.points_mm, axis=1) < 9.0).all()
    assert plan(target=target).best.ratings["centrality"] == pytest.approx(1.0, abs=0.01)
    # A structure around the centre leaves the other points.
    found = plan([forbidden("core", [0, 0, -1.5], 2.0, stop_mm=0.0)], target=target, error=0.1)
    assert 0.0 < found.best.ratings["centrality"] < 0.9


@pytest.mark.parametrize("limit", [math.inf, 5.0])
def test_distance_of_a_needle_is_that_of_libigl(limit):
    rng = np.random.default_rng(1)
    mesh = trimesh.creation.annulus(r_min=4.0, r_max=9.0, height=12.0)
    surface = closed_surface(SurfaceMesh(FRAME, mesh.vertices, mesh.faces), "ring")
    starts, ends = rng.normal(scale=9.0, size=(2, 400, 3))
    found = needle_distances(surface, starts, ends, limit)
    parts = np.linspace(0.0, 1.0, 400)[:, None]
    for start, end, distance in zip(starts, ends, found, strict=True):
        axis = start + parts * (end - start)
        at_points, *_ = igl.signed_distance(axis, mesh.vertices, mesh.faces.astype(np.int64))
        gap = np.linalg.norm(end - start) / 2 / (len(parts) - 1)
        lowest = min(at_points.min(), limit)
        assert lowest - gap - 1e-6 <= distance <= lowest + DEPTH_TOLERANCE_MM + 1e-6


def test_entries_of_a_surface_are_spread_by_area_within_the_box():
    skin = trimesh.creation.box([40.0, 40.0, 40.0])
    region = EntryRegion.of_surface(
        SurfaceMesh(FRAME, skin.vertices, skin.faces), box_mm=([-9, -9, 0], [9, 9, 30]), count=9000
    )
    assert (np.abs(region.points_mm[:, :2]) <= 9.0).all()
    assert region.points_mm[:, 2] == pytest.approx(20.0)
    assert region.normals == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(region.normals), 1)))
    quadrant = (region.points_mm[:, :2] > 0.0).all(axis=1).mean()
    assert quadrant == pytest.approx(0.25, abs=0.05)


def test_segment_gives_entries_from_end_to_end():
    region = EntryRegion.of_segment(FRAME, [[-20, 0, 60], [20, 0, 60]], [0, 0, 1], count=41)
    assert region.points_mm[[0, -1]].tolist() == [[-20, 0, 60], [20, 0, 60]]
    assert plan(region=region).best.entry_mm.tolist() == [0, 0, 60]


@pytest.fixture(scope="module")
def arm(project_root):
    """A plan's robot with its stylus as the needle, and the tip where its joints are at rest."""
    robot = load_robot(project_root / "data" / "robots" / "touch" / "touch.urdf")
    tip = robot.forward_kinematics(dict.fromkeys(robot.actuated_joint_names, 0.2))["stylus"]
    needle = NeedleRobot(
        robot, Transform.identity(FRAME, robot.root_link), Transform.identity("stylus", "tip")
    )
    return needle, tip


def test_robot_inserts_the_needle_along_the_corridor(arm):
    robot, tip = arm
    z = tip.rotation[:, 2]
    region = EntryRegion.of_disc(FRAME, tip.translation_mm - 20.0 * z, -z, 5.0, count=200)
    target = NeedleTarget.of_points(FRAME, [tip.translation_mm])
    best = plan(region=region, target=target, robot=robot).best
    assert len(best.joints) >= 5
    direction = (best.target_mm - best.entry_mm) / best.depth_mm
    parts = np.linspace(0.0, 1.0, len(best.joints))
    for part, joints in zip(parts, best.joints, strict=True):
        reached = robot.robot.forward_kinematics(joints)["stylus"]
        place = best.entry_mm + part * (best.target_mm - best.entry_mm)
        assert reached.translation_mm == pytest.approx(place, abs=1e-5)
        assert reached.rotation[:, 2] == pytest.approx(direction, abs=1e-6)


def test_robot_out_of_reach_is_refused(arm):
    robot, _ = arm
    far = EntryRegion.of_disc(FRAME, [0, 0, 5060], [0, 0, 1], 20.0, count=200)
    with pytest.raises(NoCorridorError, match=r"^robot: reaches none of \d+ allowed corridors"):
        plan(region=far, target=NeedleTarget.of_points(FRAME, [[0, 0, 5000]]), robot=robot)


SKIN = ball([0, 0, 0], 80.0)

REFUSED = {
    "needle of length 0": lambda: Needle(0.0, 1.0, 0.0),
    "needle of negative diameter": lambda: Needle(100.0, -1.0, 0.0),
    "needle of infinite length": lambda: Needle(math.inf, 1.0, 0.0),
    "negative allowance": lambda: Needle(100.0, 1.0, -1.0),
    "no entries": lambda: EntryRegion(FRAME, np.empty((0, 3)), np.empty((0, 3))),
    "box beside the skin": lambda: EntryRegion.of_surface(SKIN, box_mm=([200] * 3, [210] * 3)),
    "entry that is not finite": lambda: EntryRegion(FRAME, [[0, 0, math.nan]], [[0, 0, 1]]),
    "normal of length 0": lambda: EntryRegion(FRAME, [[0, 0, 1]], [[0, 0, 0]]),
    "fewer normals": lambda: EntryRegion(FRAME, [[0, 0, 1], [0, 1, 1]], [[0, 0, 1]]),
    "points of two numbers": lambda: EntryRegion(FRAME, [[0, 0]], [[0, 0]]),
    "words": lambda: NeedleTarget.of_points(FRAME, [["a", "b", "c"]]),
    "disc without radius": lambda: EntryRegion.of_disc(FRAME, [0, 0, 0], [0, 0, 1], 0.0),
    "segment of three points": lambda: EntryRegion.of_segment(FRAME, np.eye(3), [0, 0, 1]),
    "target outside": lambda: NeedleTarget.of_points(FRAME, [[0, 0, 30]], ball([0, 0, 0], 9.0)),
    "target that is not finite": lambda: NeedleTarget.of_points(FRAME, [[0, math.inf, 0]]),
    "centrality above 1": lambda: NeedleTarget(FRAME, [[0, 0, 0]], [1.5]),
    "target beyond the length": lambda: plan(needle=Needle(50.0, 1.0, 0.0)),
    "negative error": lambda: plan(error=-1.0),
    "negative k": lambda: plan(k_sigma=-1.0),
    "negative stop margin": lambda: forbidden("vessel", [0, 0, 30], 8.0, stop_mm=-1.0),
    "sigma that is not finite": lambda: forbidden("vessel", [0, 0, 30], 8.0, sigma_mm=math.nan),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_input_is_refused_in_one_line(name):
    with pytest.raises(InputError, match=r"^[^:]+: .+; expected .+$"):
        REFUSED[name]()


def test_structure_in_another_frame_is_refused():
    vessel = ForbiddenStructure("vessel", ball([0, 0, 30], 8.0, "needle"), 1.0, 0.0)
    with pytest.raises(FrameError, match="vessel: is in 'needle'; expected 'patient'"):
        plan([vessel])


def test_open_structure_is_refused():
    shape = trimesh.creation.icosphere(2, 8.0)
    mesh = SurfaceMesh(FRAME, shape.vertices, shape.faces[1:])
    with pytest.raises(MeshError, match="the mesh of 'vessel' is not closed"):
        plan([ForbiddenStructure("vessel", mesh, 1.0, 0.0)])


def test_corridors_keep_their_distance_and_score_as_the_best_of_an_exhaustive_search():
    """Judged by coal; ten thousand scenes: `test_needle_scenes_exhaustive`."""
    check_scenes(range(2))
