import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.geometry import InputError, Transform
from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME
from app.synthetic.motion import JointMotion, Path, Waypoint

AT_REST = np.zeros(3)


def pose(x, y, z, turn=(0.0, 0.0, 0.0)):
    return Transform.from_rotation_vector(
        turn, (x, y, z), target=BASE_FRAME, source=CAUTERY_TIP_FRAME
    )


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
    expected = Transform(BASE_FRAME, CAUTERY_TIP_FRAME, rotation, np.array([120.0, -40.0, 60.0]))
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
