"""Random pushes of a needle that the limiter holds on its path, judged by vector algebra."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.fixture import (
    Constraint,
    FixtureRule,
    FreeMotion,
    LimiterParameters,
    MarginState,
    limit_twist,
)
from app.geometry import NS_PER_MS, NS_PER_S, FrameError, InputError, Transform
from app.planning import NeedlePath, needle_constraint
from app.planning.needle_constraint import LEVER_MM
from tests.doubles import simulated_message

pytestmark = pytest.mark.slow

PATH = NeedlePath("ct", [12.0, -30.0, 70.0], [-20.0, 15.0, 12.0])
WAY = (PATH.target_mm - PATH.entry_mm) / PATH.depth_mm
TOLERANCE_MM, STEP_S = 1.0, 0.005
LIMITS = LimiterParameters()
ALLOWED_MM = 0.1


def constraint(pose, **values):
    return needle_constraint(PATH, pose, **{"tolerance_mm": 1.0, "may_advance": True} | values)


def on_path(part, rng, lateral_mm=0.0, tilt_rad=0.0):
    """A needle with its tip at a part of the depth, beside the path and tilted."""
    turn, _ = Rotation.align_vectors([WAY], [[0.0, 0.0, 1.0]])
    side = np.cross(WAY, rng.normal(size=3))
    side /= np.linalg.norm(side)
    rotation = (Rotation.from_rotvec(tilt_rad * side) * turn).as_matrix()
    tip = PATH.entry_mm + part * PATH.depth_mm * WAY + lateral_mm * np.cross(WAY, side)
    return Transform("ct", "needle", rotation, tip)


def moved(pose, twist):
    """``pose`` after `STEP_S` of a constant twist of its tip."""
    rotation = Rotation.from_rotvec(STEP_S * twist[3:]).as_matrix() @ pose.rotation
    return Transform("ct", "needle", rotation, pose.translation_mm + STEP_S * twist[:3])


def depth_of(pose):
    return float((pose.translation_mm - PATH.entry_mm) @ WAY)


def farthest_mm(pose):
    """Largest distance of the inserted shaft, or of its last 20 mm, from the path's axis."""
    length = max(depth_of(pose) / float(pose.rotation[:, 2] @ WAY), LEVER_MM)
    shaft = pose.translation_mm - np.linspace(0.0, length, 50)[:, None] * pose.rotation[:, 2]
    return float(np.linalg.norm(np.cross(shaft - PATH.entry_mm, WAY), axis=1).max())


def withdrawal_mm_s(pose, **values):
    """Speed against the path that the limiter leaves of a pull of 20 mm/s along the needle."""
    pull = np.concatenate([-20.0 * pose.rotation[:, 2], np.zeros(3)])
    planes = constraint(pose, **values)
    return -float(limit_twist(pull, planes, pose.translation_mm, LIMITS)[:3] @ WAY)


@pytest.mark.parametrize("seed", range(4))
def test_pushed_needle_never_leaves_its_path_and_can_always_be_withdrawn(seed):
    rng = np.random.default_rng(seed)
    pose = on_path(rng.uniform(0.0, 0.9), rng)
    reached_mm, deepest_mm = 0.0, -math.inf
    for step in range(200):
        if step % 20 == 0:
            push = rng.normal(size=6) * np.repeat([120.0, 2.0], 3)
            push[:3] += rng.uniform(-20.0, 80.0) * WAY
        twist = limit_twist(push, constraint(pose), pose.translation_mm, LIMITS)
        pose = moved(pose, twist)
        reached_mm, deepest_mm = max(reached_mm, farthest_mm(pose)), max(deepest_mm, depth_of(pose))
        assert reached_mm <= TOLERANCE_MM + ALLOWED_MM
        assert deepest_mm <= PATH.depth_mm + ALLOWED_MM
        if step % 10 == 0:
            for may_advance in (True, False):
                assert withdrawal_mm_s(pose, may_advance=may_advance) > 18.0
    assert reached_mm > 0.4 * TOLERANCE_MM  # the pushes use the tolerance


@pytest.mark.parametrize(("latency", "period"), [(0, 1), (4, 5), (7, 8)])
def test_late_planes_hold_the_needle_by_the_rule_of_a_controller(latency, period):
    """Latency and period in steps; the robot follows a velocity with a lag of 10 ms."""
    rng = np.random.default_rng(latency)
    pose, twist = on_path(0.2, rng), np.zeros(6)
    rule, sent = FixtureRule(frame="ct", accept_simulated=True), []
    reached_mm, start_mm = 0.0, depth_of(pose)
    for step in range(300):
        now_ns = NS_PER_S + round(step * STEP_S * NS_PER_S)
        if step % period == 0:
            planes, valid_ns = constraint(pose), 200 * NS_PER_MS
            sent.append(simulated_message(planes, MarginState.NEGATIVE, step, now_ns, valid_ns))
        if step >= latency and (step - latency) % period == 0:
            rule.receive(sent.pop(0), now_ns)
        if step % 20 == 0:
            push = rng.normal(size=6) * np.repeat([60.0, 1.0], 3)
            push[:3] += 40.0 * WAY
        allowed = rule.allow(push, pose.translation_mm, now_ns).twist
        twist = twist + (allowed - twist) * -math.expm1(-STEP_S / 0.01)
        pose = moved(pose, twist)
        reached_mm = max(reached_mm, farthest_mm(pose))
    assert 0.1 < reached_mm <= TOLERANCE_MM + ALLOWED_MM
    assert start_mm + 2.0 < depth_of(pose) <= PATH.depth_mm + ALLOWED_MM


def test_pushed_needle_arrives_at_the_target():
    pose = on_path(0.0, np.random.default_rng(0), lateral_mm=0.3, tilt_rad=0.01)
    push = np.concatenate([30.0 * WAY, np.zeros(3)])
    for _ in range(1000):
        pose = moved(pose, limit_twist(push, constraint(pose), pose.translation_mm, LIMITS))
    assert depth_of(pose) == pytest.approx(PATH.depth_mm, abs=ALLOWED_MM)


@pytest.mark.parametrize("may_advance", [True, False])
def test_needle_that_may_not_advance_keeps_its_depth(may_advance):
    rng = np.random.default_rng(1)
    pose = on_path(0.5, rng)
    push = np.concatenate([60.0 * WAY + rng.normal(scale=20.0, size=3), rng.normal(size=3)])
    start_mm = depth_of(pose)
    for _ in range(100):
        planes = constraint(pose, may_advance=may_advance)
        pose = moved(pose, limit_twist(push, planes, pose.translation_mm, LIMITS))
    assert (depth_of(pose) > start_mm + 5.0) is may_advance
    assert may_advance or depth_of(pose) <= start_mm + 1e-6


def test_needle_beside_its_path_or_too_deep_is_driven_back():
    rng = np.random.default_rng(2)
    for pose in (on_path(0.5, rng, 3.0), on_path(0.0, rng, 0.0, 0.2), on_path(1.1, rng)):
        before_mm, pushed = farthest_mm(pose) + depth_of(pose), pose
        for _ in range(100):
            planes = constraint(pushed)
            twist = limit_twist(np.zeros(6), planes, pushed.translation_mm, LIMITS)
            pushed = moved(pushed, twist)
        assert farthest_mm(pushed) <= TOLERANCE_MM + ALLOWED_MM
        assert depth_of(pushed) <= PATH.depth_mm + ALLOWED_MM
        assert farthest_mm(pushed) + depth_of(pushed) < before_mm + ALLOWED_MM


def guard_of(pose, clearances_mm, *, hold=False):
    """Planes of structures ahead and beside the needle, at these clearances from its tip."""
    axis, side = pose.rotation[:, 2], pose.rotation[:, 0]
    normals = [-axis, *[side] * (len(clearances_mm) - 1)]
    points = np.tile(pose.translation_mm, (len(clearances_mm), 1))
    offsets = np.einsum("ij,ij->i", normals, points) - clearances_mm
    still = np.zeros_like(points)
    free = FreeMotion(50.0, 1.0)
    return Constraint("ct", normals, offsets, points, still, hold=hold, free=free)


def test_nearest_plane_of_the_guard_remains_and_the_next_one_ends_the_free_motion():
    pose = on_path(0.5, np.random.default_rng(3))
    guard = guard_of(pose, [0.5, 2.0, 3.0])
    planes = constraint(pose, guard=guard, shaft_mm=100.0)
    assert len(planes) == 8
    assert planes.rows[0].tolist() == guard.rows[0].tolist()
    assert planes.free == FreeMotion(2.0, 0.02)
    push = np.concatenate([50.0 * WAY, np.zeros(3)])
    allowed = limit_twist(push, planes, pose.translation_mm, LIMITS)[:3] @ WAY
    assert allowed == pytest.approx(0.5 / LIMITS.tau_s, abs=1e-6)


def test_advance_ends_before_the_nearest_plane_that_is_left_out():
    pose = on_path(0.5, np.random.default_rng(5))
    beside, ahead = pose.rotation[:, 0], -pose.rotation[:, 2]
    points = np.tile(pose.translation_mm, (2, 1))
    normals = np.array([beside, ahead])
    offsets = np.einsum("ij,ij->i", normals, points) - [0.5, 0.6]
    guard = Constraint("ct", normals, offsets, points, 0.0 * points, hold=False)
    planes = constraint(pose, guard=guard, shaft_mm=100.0)
    push = np.concatenate([200.0 * WAY, np.zeros(3)])
    allowed = limit_twist(push, planes, pose.translation_mm, LIMITS)
    assert allowed[:3] @ WAY == pytest.approx(0.6 / LIMITS.tau_s, abs=1e-6)


def test_needle_in_the_margin_of_a_plane_that_is_left_out_may_only_be_withdrawn():
    pose = on_path(0.5, np.random.default_rng(4))
    axis = pose.rotation[:, 2]
    far, near = guard_of(pose, [-0.2]), guard_of(pose, [5.0, -0.3, -0.1])
    guard = Constraint(
        "ct",
        *(np.concatenate([getattr(near, name), getattr(far, name)]) for name in (
            "normals", "offsets_mm", "points_on_tool_mm", "tumor_velocities_mm_s"
        )),
        hold=False,
    )  # fmt: skip
    planes = constraint(pose, guard=guard, shaft_mm=100.0)
    push = np.concatenate([50.0 * axis, np.zeros(3)])
    assert limit_twist(push, planes, pose.translation_mm, LIMITS)[:3] @ axis <= 1e-6
    assert withdrawal_mm_s(pose, guard=guard, shaft_mm=100.0) > 15.0


@pytest.mark.parametrize("seed", range(10))
def test_hold_of_the_guard_allows_withdrawal_alone(seed):
    rng = np.random.default_rng(seed)
    pose = on_path(rng.uniform(0.3, 0.9), rng, 0.2, rng.uniform(0.0, 0.008))
    guard = guard_of(pose, [1.0], hold=True)
    values = {"guard": guard, "shaft_mm": 100.0}
    assert constraint(pose, **values).hold
    assert withdrawal_mm_s(pose, **values) > 18.0
    push = rng.normal(size=6) * np.repeat([50.0, 1.0], 3)
    planes = constraint(pose, **values)
    twist = limit_twist(push, planes, pose.translation_mm, LIMITS)
    assert farthest_mm(moved(pose, twist)) <= farthest_mm(pose) + 1e-3
    assert twist[:3] @ WAY <= 1e-6


def test_planes_move_with_the_frame():
    rng = np.random.default_rng(5)
    pose = on_path(0.4, rng, 0.3, 0.01)
    other = Transform("tumor", "ct", Rotation.random(random_state=rng).as_matrix(), [5, 60, -7])
    there = needle_constraint(
        PATH.in_frame(other), other @ pose, tolerance_mm=1.0, may_advance=True
    )
    assert there.frame == "tumor"
    # The triangle lies otherwise around the axis; the end of the advance is the same plane.
    assert there.normals[6] == pytest.approx(other.rotate(constraint(pose).normals[6]))
    assert there.clearances_mm[6] == pytest.approx(0.6 * PATH.depth_mm)


POSE = on_path(0.5, np.random.default_rng(0))
AWAY = Transform("ct", "needle", -POSE.rotation @ np.diag([1, -1, 1]), POSE.translation_mm)
NAN = Transform.unchecked("ct", "needle", np.full((3, 3), math.nan), POSE.translation_mm)
REFUSED = {
    "tolerance 0": lambda: constraint(POSE, tolerance_mm=0.0),
    "tolerance that is not finite": lambda: constraint(POSE, tolerance_mm=math.nan),
    "needle that points away": lambda: constraint(AWAY),
    "pose that is not finite": lambda: constraint(NAN),
    "guard without the tool's length": lambda: constraint(POSE, guard=guard_of(POSE, [1.0])),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_value_is_refused_in_one_line(name):
    with pytest.raises(InputError, match=r"^[^:]+: .+; expected .+$"):
        REFUSED[name]()


def test_guard_in_another_frame_is_refused():
    guard = Constraint("tumor", [[0, 0, 1]], [0], [[0, 0, 0]], [[0, 0, 0]], hold=False)
    with pytest.raises(FrameError, match="guard: is in 'tumor'; expected 'ct' as the path"):
        constraint(POSE, guard=guard, shaft_mm=100.0)
