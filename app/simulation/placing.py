"""Places bodies of a compiled world, and copies a state into another model of the same arms."""

from typing import Any

import mujoco

from app.geometry import Transform
from app.simulation.body_model import quaternion_wxyz
from app.simulation.inertia import M_PER_MM

_POSITIONS = {
    mujoco.mjtJoint.mjJNT_FREE: (7, 6),
    mujoco.mjtJoint.mjJNT_BALL: (4, 3),
    mujoco.mjtJoint.mjJNT_SLIDE: (1, 1),
    mujoco.mjtJoint.mjJNT_HINGE: (1, 1),
}
"""Numbers of positions and velocities of each type of joint."""


def place_body(model: Any, data: Any, name: str, world_from_body: Transform) -> None:
    """Put the body ``name`` of the world at a pose; a free one is at rest there."""
    body = model.body(name)
    position = M_PER_MM * world_from_body.translation_mm
    quaternion = quaternion_wxyz(world_from_body.rotation)
    mocap = int(model.body_mocapid[body.id])
    if mocap >= 0:
        data.mocap_pos[mocap], data.mocap_quat[mocap] = position, quaternion
        return
    joint = int(model.body_jntadr[body.id])
    first, velocity = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    data.qpos[first : first + 3], data.qpos[first + 3 : first + 7] = position, quaternion
    data.qvel[velocity : velocity + 6] = 0.0


def copy_state(model: Any, data: Any, new_model: Any, new_data: Any) -> None:
    """Copy joints and driven bodies that both models have, by their names; all joints have one."""
    for index in range(new_model.njnt):
        joint = new_model.joint(index)
        old = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint.name)
        if old < 0:
            continue
        count, speeds = _POSITIONS[mujoco.mjtJoint(int(new_model.jnt_type[index]))]
        to, of = int(new_model.jnt_qposadr[index]), int(model.jnt_qposadr[old])
        new_data.qpos[to : to + count] = data.qpos[of : of + count]
        to, of = int(new_model.jnt_dofadr[index]), int(model.jnt_dofadr[old])
        new_data.qvel[to : to + speeds] = data.qvel[of : of + speeds]
    for index in range(new_model.nbody):
        mocap = int(new_model.body_mocapid[index])
        name = new_model.body(index).name
        old = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if mocap < 0 or old < 0 or model.body_mocapid[old] < 0:
            continue
        new_data.mocap_pos[mocap] = data.mocap_pos[model.body_mocapid[old]]
        new_data.mocap_quat[mocap] = data.mocap_quat[model.body_mocapid[old]]
