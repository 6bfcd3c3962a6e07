"""Motion: paths, arms, breathing, poses at many times, and the script of a case."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.geometry import FrameError, InputError, Transform
from app.synthetic import BASE_FRAME, TIP_FRAME
from app.synthetic.motion import Breathing, BreathingBody, JointMotion, Path, Poses, Waypoint
from app.synthetic.script import PLUNGE_FROM_MM, Script

pytestmark = pytest.mark.slow

AT_REST = np.zeros(3)


def pose(x, y, z, turn=(0.0, 0.0, 0.0)):
    return Transform.from_rotation_vector(turn, (x, y, z), target=BASE_FRAME, source=TIP_FRAME)


@pytest.fixture
def path():
    return Path(
        [
            Waypoint(0.0, pose(0.0, 0.0, 0.0), AT_REST),
            Waypoint(1.0, pose(10.0, 0.0, 5.0, (0.3, 0.0, 0.0)), np.array([20.0, 0.0, 0.0])),
            Waypoint(2.0, pose(20.0, 5.0, 0.0, (0.3, -0.4, 0.0)), AT_REST),
            Waypoint(3.0, pose(20.0, 5.0, 0.0, (0.3, -0.4, 0.0)), AT_REST),
            Waypoint(4.0, pose(0.0, 0.0, 0.0), AT_REST),
        ]
    )


def test_a_path_goes_through_its_waypoints_with_their_velocities(path):
    middle = path.at(1.0)
    np.testing.assert_allclose(middle.translation_mm, (10.0, 0.0, 5.0), atol=1e-9)
    np.testing.assert_allclose(middle.rotation_vector, (0.3, 0.0, 0.0), atol=1e-9)
    step = 1e-4
    velocity = (path.at(1.0 + step).translation_mm - path.at(1.0 - step).translation_mm) / (
        2 * step
    )
    np.testing.assert_allclose(velocity, (20.0, 0.0, 0.0), atol=1e-4)


def test_pose_at_rest_is_constant(path):
    for time_s in np.linspace(2.0, 3.0, 21):
        np.testing.assert_allclose(path.at(time_s).matrix, path.at(2.0).matrix, atol=1e-12)


def test_path_is_constant_beyond_its_ends(path):
    np.testing.assert_array_equal(path.at(-1.0).matrix, path.at(0.0).matrix)
    np.testing.assert_array_equal(path.at(9.0).matrix, path.at(4.0).matrix)


@given(st.floats(0.0, 1.0))
def test_path_between_rests_is_the_minimum_jerk_trajectory(s):
    straight = Path(
        [Waypoint(0.0, pose(0.0, 0.0, 0.0), AT_REST), Waypoint(1.0, pose(8.0, 0.0, 0.0), AT_REST)]
    )
    minimum_jerk = 8.0 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    assert straight.at(s).translation_mm[0] == pytest.approx(minimum_jerk, abs=1e-9)


def test_waypoint_times_that_do_not_rise_are_refused():
    with pytest.raises(InputError, match="expected two or more, rising"):
        Path([Waypoint(1.0, pose(0, 0, 0), AT_REST), Waypoint(1.0, pose(1, 0, 0), AT_REST)])


def test_rotation_beyond_the_limit_is_refused():
    with pytest.raises(InputError, match=r"rotated by 2\.900 rad"):
        Path(
            [
                Waypoint(0.0, pose(0, 0, 0), AT_REST),
                Waypoint(1.0, pose(0, 0, 0, (2.9, 0.0, 0.0)), AT_REST),
            ]
        )


def test_arm_reaches_the_poses_of_its_knots(path, gantry):
    times = np.arange(0.0, 4.01, 0.05)
    poses = [path.at(time_s) for time_s in times]
    motion = JointMotion(gantry, times, poses)
    for time_s, expected in zip(times, poses, strict=True):
        reached = motion.base_from_tool(time_s)
        assert reached.distance_mm_to(expected) < 1e-9
        assert reached.angle_to(expected) < 1e-9


def test_an_arm_that_holds_a_pose_keeps_its_joints(path, gantry):
    class CreepingArm(type(gantry)):
        """Inverse kinematics with a tolerance: each call gives a slightly different solution."""

        calls = 0

        def joints_for(self, base_from_tool, seed):
            self.calls += 1
            found = super().joints_for(base_from_tool, seed)
            return {**found, "x": found["x"] + 1e-9 * self.calls}

    times = np.arange(0.0, 4.01, 0.05)
    motion = JointMotion(CreepingArm(), times, [path.at(time_s) for time_s in times])
    held = np.array([motion.positions(time_s) for time_s in np.linspace(2.05, 2.95, 50)])
    assert (held == held[0]).all()


def test_gantry_kinematics_are_consistent(gantry):
    rotation = Rotation.from_rotvec((0.3, -0.2, 0.5)).as_matrix() @ np.diag([-1.0, 1.0, -1.0])
    expected = Transform(BASE_FRAME, TIP_FRAME, rotation, np.array([120.0, -40.0, 60.0]))
    reached = gantry.base_from_tool(gantry.joints_for(expected, None))
    np.testing.assert_allclose(reached.matrix, expected.matrix, atol=1e-9)


def test_positions_at_one_time_have_the_bits_of_those_at_many(gantry):
    poses = [pose(20.0 * np.sin(k), 5.0 * np.cos(k), 0.1 * k) for k in range(60)]
    motion = JointMotion(gantry, 0.02 * np.arange(60.0), poses)
    times = np.concatenate(
        [np.random.default_rng(2).uniform(-0.1, 1.4, 500), 0.02 * np.arange(60.0)]
    )
    one_by_one = [motion.positions(time_s) for time_s in times.tolist()]
    assert (np.array(one_by_one) == motion.positions(times)).all()


BREATHING = Breathing(held_until_s=18.0)


@given(st.floats(0.0, 18.0))
def test_held_breath_has_depth_zero(time_s):
    assert BREATHING.depth(time_s) == 0.0


@given(st.floats(18.0, 200.0))
def test_a_breath_takes_four_seconds_and_stays_between_its_ends(time_s):
    assert 0.0 <= BREATHING.depth(time_s) <= 1.0
    assert BREATHING.depth(time_s + 4.0) == pytest.approx(BREATHING.depth(time_s), abs=1e-9)


def test_inspiration_is_full_half_way_and_most_time_is_spent_near_expiration():
    assert BREATHING.depth(20.0) == pytest.approx(1.0)
    depths = [BREATHING.depth(time_s) for time_s in np.linspace(18.0, 22.0, 401)]
    assert np.mean(np.array(depths) < 0.25) > 0.45


def test_body_is_displaced_and_rotated_about_its_origin():
    rest = Transform.from_rotation_vector(
        (0.0, 0.0, 1.0), (10.0, 20.0, 30.0), target="tracker", source="needle"
    )
    body = BreathingBody(rest, np.array([0.0, 2.0, 4.0]), np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(body.at(0.0).matrix, rest.matrix, atol=1e-15)
    half = body.at(0.5)
    np.testing.assert_allclose(half.translation_mm, (10.0, 21.0, 32.0))
    assert rest.angle_to(half) == pytest.approx(0.01)
    np.testing.assert_allclose(half.rotate((1.0, 0.0, 0.0)), rest.rotate((1.0, 0.0, 0.0)))


def turned(target, source, seed):
    random = np.random.default_rng(seed)
    return [
        Transform.from_rotation_vector(
            random.normal(size=3), 50.0 * random.normal(size=3), target=target, source=source
        )
        for _ in range(40)
    ]


def assert_same(poses, transforms):
    assert (poses.target, poses.source) == (transforms[0].target, transforms[0].source)
    for found, expected in zip(poses.transforms(), transforms, strict=True):
        np.testing.assert_allclose(found.matrix, expected.matrix, rtol=0.0, atol=1e-12)


def test_operations_are_those_of_single_transforms():
    a_from_b, b_from_c = turned("a", "b", 1), turned("b", "c", 2)
    one, other = Poses.of(a_from_b), Poses.of(b_from_c)
    assert_same(
        one @ other, [first @ second for first, second in zip(a_from_b, b_from_c, strict=True)]
    )
    assert_same(Poses.of(a_from_b[:1]) @ other, [a_from_b[0] @ each for each in b_from_c])
    assert_same(one.inverse(), [each.inverse() for each in a_from_b])
    points = np.arange(6.0).reshape(2, 3)
    np.testing.assert_allclose(one.apply(points), [each.apply(points) for each in a_from_b])
    with pytest.raises(FrameError, match="a_from_b cannot be multiplied by a_from_b"):
        one @ one


DIRECTION = np.array([0.0, 0.0, -1.0])


def tip_at(x, y, z):
    return Transform("tumor", "tip", np.eye(3), np.array([x, y, z], dtype=float))


def height_over_floor(tumor_from_tip):
    return float(tumor_from_tip.translation_mm[2]) - 3.0


@pytest.fixture
def plunge():
    script = Script(tip_at(0.0, 0.0, 40.0), height_over_floor)
    script.plunge(tip_at(1.0, 2.0, 4.0), DIRECTION, depth_mm=2.0, hold_s=0.3, speed_mm_s=45.0)
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
    script = Script(tip_at(0.0, 0.0, 40.0), height_over_floor)
    assert script.rest(1.3) == (0.0, 1.3)
    script.move_to(tip_at(10.0, 0.0, 40.0), 2.0)
    assert script.rest(0.5) == pytest.approx((3.3, 3.8))
    assert script.end_s == script.path.end_s


def test_a_stroke_passes_its_poses_without_stopping():
    script = Script(tip_at(0.0, 0.0, 40.0), height_over_floor)
    script.stroke([tip_at(10.0, 0.0, 40.0), tip_at(20.0, 5.0, 40.0), tip_at(30.0, 0.0, 40.0)], 3.0)
    path, step = script.path, 1e-4
    np.testing.assert_allclose(path.at(2.0).translation_mm, (20.0, 5.0, 40.0), atol=1e-9)
    through = path.at(2.0 + step).translation_mm - path.at(2.0 - step).translation_mm
    np.testing.assert_allclose(through / (2.0 * step), (10.0, 0.0, 0.0), atol=1e-4)
    into = path.at(3.0).translation_mm - path.at(3.0 - step).translation_mm
    assert np.linalg.norm(into) / step < 0.01
