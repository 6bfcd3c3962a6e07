import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from app.geometry import InputError, Transform
from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME
from app.synthetic.motion import JointMotion, Path, Waypoint

STILL = np.zeros(3)


def pose(x, y, z, turn=(0.0, 0.0, 0.0)):
    return Transform.from_rotation_vector(
        turn, (x, y, z), target=BASE_FRAME, source=CAUTERY_TIP_FRAME
    )


@pytest.fixture
def path():
    return Path(
        [
            Waypoint(0.0, pose(0.0, 0.0, 0.0), STILL),
            Waypoint(1.0, pose(10.0, 0.0, 5.0, (0.3, 0.0, 0.0)), np.array([20.0, 0.0, 0.0])),
            Waypoint(2.0, pose(20.0, 5.0, 0.0, (0.3, -0.4, 0.0)), STILL),
            Waypoint(3.0, pose(20.0, 5.0, 0.0, (0.3, -0.4, 0.0)), STILL),
            Waypoint(4.0, pose(0.0, 0.0, 0.0), STILL),
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


def test_what_rests_is_still(path):
    for time_s in np.linspace(2.0, 3.0, 21):
        np.testing.assert_allclose(path.at(time_s).matrix, path.at(2.0).matrix, atol=1e-12)


def test_beyond_its_ends_a_path_rests(path):
    np.testing.assert_array_equal(path.at(-1.0).matrix, path.at(0.0).matrix)
    np.testing.assert_array_equal(path.at(9.0).matrix, path.at(4.0).matrix)


@given(st.floats(0.0, 1.0))
def test_from_rest_to_rest_the_jerk_is_least(s):
    straight = Path(
        [Waypoint(0.0, pose(0.0, 0.0, 0.0), STILL), Waypoint(1.0, pose(8.0, 0.0, 0.0), STILL)]
    )
    minimum_jerk = 8.0 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    assert straight.at(s).translation_mm[0] == pytest.approx(minimum_jerk, abs=1e-9)


def test_times_that_do_not_rise_are_refused():
    with pytest.raises(InputError, match="must rise"):
        Path([Waypoint(1.0, pose(0, 0, 0), STILL), Waypoint(1.0, pose(1, 0, 0), STILL)])


def test_a_turn_too_wide_for_rotation_vectors_is_refused():
    with pytest.raises(InputError, match=r"turned by 2\.900 rad"):
        Path(
            [
                Waypoint(0.0, pose(0, 0, 0), STILL),
                Waypoint(1.0, pose(0, 0, 0, (2.9, 0.0, 0.0)), STILL),
            ]
        )


def test_an_arm_is_at_the_poses_of_its_knots(path, gantry):
    times = np.arange(0.0, 4.01, 0.05)
    poses = [path.at(time_s) for time_s in times]
    motion = JointMotion(gantry, times, poses)
    for time_s, wanted in zip(times, poses, strict=True):
        reached = motion.base_from_tool(time_s)
        assert reached.distance_mm_to(wanted) < 1e-9
        assert reached.angle_to(wanted) < 1e-9


def test_an_arm_that_holds_a_pose_keeps_its_joints(path, gantry):
    class CreepingArm(type(gantry)):
        """Another solution at each call, as inverse kinematics to a tolerance gives."""

        calls = 0

        def joints_for(self, base_from_tool, seed):
            self.calls += 1
            found = super().joints_for(base_from_tool, seed)
            return {**found, "x": found["x"] + 1e-9 * self.calls}

    times = np.arange(0.0, 4.01, 0.05)
    motion = JointMotion(CreepingArm(), times, [path.at(time_s) for time_s in times])
    held = np.array([motion.positions(time_s) for time_s in np.linspace(2.05, 2.95, 50)])
    assert (held == held[0]).all()


def test_the_gantry_of_these_tests_inverts_itself(gantry):
    rotation = Rotation.from_rotvec((0.3, -0.2, 0.5)).as_matrix() @ np.diag([-1.0, 1.0, -1.0])
    wanted = Transform(BASE_FRAME, CAUTERY_TIP_FRAME, rotation, np.array([120.0, -40.0, 60.0]))
    reached = gantry.base_from_tool(gantry.joints_for(wanted, None))
    np.testing.assert_allclose(reached.matrix, wanted.matrix, atol=1e-9)
