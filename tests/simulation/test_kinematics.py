"""Poses of links in the physics are those of the robot's own forward kinematics."""

import numpy as np
import pytest

from app.robot import Robot, load_robot
from app.simulation import World
from tests.simulation.conftest import PARALLELOGRAMS, arm, world_of

pytestmark = pytest.mark.long

TOLERANCE_MM = 1e-6
"""1e-9 m."""


def check_poses(robot: Robot) -> None:
    world = World(world_of(arm(robot, collision="none")))
    world_from_base = world.description.robots[0].world_from_base
    random = np.random.default_rng(5)
    joints = {joint.name: joint for joint in robot.joints}
    for _ in range(20):
        positions = {
            name: float(np.clip(random.uniform(-0.8, 0.8), joints[name].lower, joints[name].upper))
            for name in robot.actuated_joint_names
        }
        state = world.reset({"arm": positions})
        expected = robot.forward_kinematics(positions)
        links = state.arms["arm"].links
        for link, pose in links.items():
            world_from_link = world_from_base @ expected[link]
            error = np.abs(pose.translation_mm - world_from_link.translation_mm).max()
            assert error <= TOLERANCE_MM, link
            assert np.abs(pose.rotation - world_from_link.rotation).max() <= 1e-9, link
        assert len(links) >= len(robot.actuated_joint_names)


def test_shipped_arm(touch):
    check_poses(touch)


@pytest.mark.parametrize("name", ["parallelogram", "two_arms"])
def test_shipped_parallelograms(name):
    check_poses(load_robot(PARALLELOGRAMS / f"{name}.yaml"))


@pytest.mark.parametrize(
    "path", ["ur_description/urdf/ur5_robot.urdf", "panda_description/urdf/panda.urdf"]
)
def test_robots_with_masses_of_their_own(example_robots, path):
    check_poses(load_robot(example_robots / path))


@pytest.mark.parametrize("path", ["omni/urdf/omni.urdf", "ambf_kuka/blender-kuka.yaml"])
def test_robots_of_other_projects(shared_data, path):
    check_poses(load_robot(shared_data / path, package_dirs=[shared_data]))


BALL = """
bodies: [BODY post, BODY pen]
joints: [JOINT ball]
BODY post:
  {name: post, mass: 0.0, mesh: '', shape: Box, geometry: {x: 0.1, y: 0.1, z: 0.1},
   collision shape: Box, collision geometry: {x: 0.1, y: 0.1, z: 0.1},
   location: {position: {x: 0, y: 0, z: 0}, orientation: {r: 0, p: 0, y: 0}}}
BODY pen:
  {name: pen, mass: 0.5, mesh: '', shape: Box, geometry: {x: 0.1, y: 0.02, z: 0.02},
   collision shape: Box, collision geometry: {x: 0.1, y: 0.02, z: 0.02},
   location: {position: {x: 0.1, y: 0.2, z: 0}, orientation: {r: 0.3, p: 0, y: 0}}}
JOINT ball:
  {name: ball, parent: BODY post, child: BODY pen, type: p2p,
   parent pivot: {x: 0.1, y: 0.2, z: 0.05}, parent axis: {x: 0, y: 0, z: 1},
   child pivot: {x: 0, y: 0.02, z: 0.03}, child axis: {x: 0, y: 0, z: 1}}
"""


def test_ball_joint_is_three_hinges_of_one_body(tmp_path):
    path = tmp_path / "ball.yaml"
    path.write_text(BALL)
    robot = load_robot(path)
    assert robot.actuated_joint_names == ("ball-x", "ball-y", "ball-z")
    world = World(world_of(arm(robot)))
    assert [link for link in world.state().arms["arm"].links if "ball" in link] == []
    check_poses(robot)
