"""Accelerations of the joints without contact are those of Pinocchio, an independent library."""

import mujoco
import numpy as np
import pinocchio
import pytest

from app.robot import load_robot
from app.simulation import World
from tests.simulation.conftest import arm, world_of
from tests.simulation.random_arms import largest_difference

pytestmark = pytest.mark.long

TOLERANCE = 1e-6
"""Relative to the largest acceleration, and absolute below 1 rad/s2."""


@pytest.mark.parametrize(
    "path", ["ur_description/urdf/ur5_robot.urdf", "kinova_description/robots/kinova.urdf"]
)
def test_joint_accelerations(example_robots, path):
    file = example_robots / path
    robot = load_robot(file, require_meshes=False)
    robot = type(robot)(robot.name, robot.links, robot.joints)
    world = World(world_of(arm(robot, collision="none")))
    model, data = world.model, world.data
    theirs = pinocchio.buildModelFromUrdf(str(file))
    theirs.gravity.linear = np.array([0.0, 0.0, -world.description.gravity_m_s2])
    work = theirs.createData()
    names = [str(name) for name in theirs.names[1:]]
    order = [model.jnt_dofadr[model.joint(f"arm/{name}").id] for name in names]
    assert len(order) == model.nv == theirs.nv
    limits = {joint.name: (joint.lower, joint.upper) for joint in robot.joints}
    lower, upper = np.array([np.clip(limits[name], -3.0, 3.0) for name in names]).T * 0.999
    random = np.random.default_rng(11)
    for _ in range(50):
        world.reset()
        # Inside the limits, so that no force of a limit acts.
        positions = random.uniform(lower, upper)
        speeds = random.uniform(-2.0, 2.0, model.nv)
        efforts = random.uniform(-20.0, 20.0, model.nv)
        data.qpos[order], data.qvel[order] = positions, speeds
        data.ctrl[:], data.qfrc_applied[order] = 0.0, efforts
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        # Pinocchio applies no losses of the joints.
        losses = model.dof_damping[order].reshape(model.nv, -1)[:, 0] * speeds
        expected = pinocchio.aba(
            theirs, work, _configuration(theirs, positions), speeds, efforts - losses
        )
        scale = max(1.0, float(np.abs(expected).max()))
        assert np.abs(data.qacc[order] - expected).max() <= TOLERANCE * scale


def test_accelerations_of_random_arms(tmp_path):
    assert 0.0 < largest_difference(tmp_path, seed=4) <= 1.0  # of the tolerance


def _configuration(model, angles):
    """Continuous joints are cosine and sine there."""
    found = pinocchio.neutral(model)
    for joint, angle in zip(list(model.joints)[1:], angles, strict=True):
        if joint.nq == 2:
            found[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
        else:
            found[joint.idx_q] = angle
    return found
