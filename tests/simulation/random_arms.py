"""Accelerations of joints without contact, by MuJoCo and by Pinocchio, for random arms.

Each arm is a URDF of six hinges with axes, lengths, masses and inertias of a seed.
"""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio

from app.geometry import FloatArray, Transform
from app.robot import load_robot
from app.simulation import RobotEntry, World, WorldDescription

TOLERANCE = 1e-6
"""Relative to the largest acceleration, and absolute below 1 rad/s2."""

ARMS = 10
STATES = 20
_JOINTS = 6


def largest_difference(folder: Path, seed: int) -> float:
    """Largest difference of the accelerations of all arms and states, in units of `TOLERANCE`.

    ``folder`` receives the robots' files.
    """
    random = np.random.default_rng(seed)
    found = 0.0
    for number in range(ARMS):
        file = folder / f"arm_{number}.urdf"
        file.write_text(_random_arm(random))
        found = max(found, _difference(file, random))
    return found / TOLERANCE


def _difference(file: Path, random: np.random.Generator) -> float:
    robot = load_robot(file)
    base = Transform("world", robot.root_link, np.eye(3), np.zeros(3))
    entry = RobotEntry("arm", robot, base, {}, collision="none")
    world = World(WorldDescription("dynamics", 1, robots=(entry,)))
    model, data = world.model, world.data
    theirs = pinocchio.buildModelFromUrdf(str(file))
    theirs.gravity.linear = np.array([0.0, 0.0, -world.description.gravity_m_s2])
    work = theirs.createData()
    names = [str(name) for name in theirs.names[1:]]
    order = [model.jnt_dofadr[model.joint(f"arm/{name}").id] for name in names]
    worst = 0.0
    for _ in range(STATES):
        world.reset()
        positions = random.uniform(-2.9, 2.9, _JOINTS)  # inside the limits: no force of a limit
        speeds, efforts = random.uniform(-2.0, 2.0, (2, _JOINTS))
        data.qpos[order], data.qvel[order] = positions, speeds
        data.ctrl[:], data.qfrc_applied[order] = 0.0, efforts
        mujoco.mj_forward(model, data)
        losses = model.dof_damping[order].reshape(_JOINTS, -1)[:, 0] * speeds
        # Pinocchio applies no losses of the joints.
        expected = pinocchio.aba(theirs, work, positions, speeds, efforts - losses)
        scale = max(1.0, float(np.abs(expected).max()))
        worst = max(worst, float(np.abs(data.qacc[order] - expected).max()) / scale)
    return worst


def _random_arm(random: np.random.Generator) -> str:
    parts = ['<robot name="random"><link name="link_0"/>']
    for number in range(1, _JOINTS + 1):
        axis = random.normal(size=3)
        parts.append(
            f'<link name="link_{number}"><inertial>'
            f'<origin xyz="{_text(random.uniform(-0.1, 0.1, 3))}" '
            f'rpy="{_text(random.uniform(-3.0, 3.0, 3))}"/>'
            f'<mass value="{random.uniform(0.2, 3.0):.6f}"/>{_inertia(random)}</inertial></link>'
            f'<joint name="joint_{number}" type="revolute"><parent link="link_{number - 1}"/>'
            f'<child link="link_{number}"/><origin xyz="{_text(random.uniform(-0.3, 0.3, 3))}" '
            f'rpy="{_text(random.uniform(-3.0, 3.0, 3))}"/>'
            f'<axis xyz="{_text(axis / np.linalg.norm(axis))}"/>'
            '<limit lower="-3" upper="3" effort="50" velocity="10"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def _inertia(random: np.random.Generator) -> str:
    """Principal moments of three perpendicular extents, so that a body with them exists."""
    x, y, z = random.uniform(1e-4, 2e-2, 3)
    return (
        f'<inertia ixx="{y + z:.9f}" iyy="{x + z:.9f}" izz="{x + y:.9f}" ixy="0" ixz="0" iyz="0"/>'
    )


def _text(values: FloatArray) -> str:
    return " ".join(f"{value:.12f}" for value in values)
