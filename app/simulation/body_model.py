"""Bodies, surfaces, masses and moving tissue in a MuJoCo model; metres here, mm outside."""

from typing import Any

import mujoco
import numpy as np

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.simulation.rigid_body import M_PER_MM, Inertia, convex_parts
from app.simulation.world_entries import BreathingEntry, Collision, TissueEntry
from app.synthetic.motion import Breathing

CONTACT_SOLREF = (0.002, 1.0)
CONTACT_SOLIMP = (0.99, 0.999, 0.0001, 0.5, 2.0)
"""Contacts: time constant of 2 ms, critically damped; nearly rigid from 0.1 mm of overlap."""
_POSITIONS = {
    mujoco.mjtJoint.mjJNT_FREE: (7, 6),
    mujoco.mjtJoint.mjJNT_BALL: (4, 3),
    mujoco.mjtJoint.mjJNT_SLIDE: (1, 1),
    mujoco.mjtJoint.mjJNT_HINGE: (1, 1),
}
"""Numbers of positions and velocities of each type of joint."""


def quaternion_wxyz(rotation: FloatArray) -> FloatArray:
    """The rotation (3, 3) as MuJoCo's quaternion (4,)."""
    quaternion: FloatArray = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return quaternion


class BodyWriter:
    """Adds bodies to ``spec``."""

    def __init__(self, spec: Any) -> None:
        self.spec = spec
        self.world: Any = spec.worldbody
        self._meshes = 0

    def add_body(
        self,
        parent: Any,
        name: str,
        parent_from_body: Transform,
        mesh: SurfaceMesh,
        collision: Collision,
        friction: float,
        *,
        inertia: Inertia | None = None,
        is_free: bool = False,
        is_driven: bool = False,
    ) -> None:
        """Add a body with one surface; ``is_driven``: its pose is set from outside (mocap)."""
        body = parent.add_body(
            name=name,
            pos=M_PER_MM * parent_from_body.translation_mm,
            quat=quaternion_wxyz(parent_from_body.rotation),
            mocap=is_driven,
        )
        if is_free:
            body.add_freejoint(name=name)
        if inertia is not None:
            self.set_inertia(body, inertia)
        self.add_surface(body, mesh, collision, friction, f"body {name!r}")

    def set_inertia(self, body: Any, inertia: Inertia) -> None:
        """Set mass, centre of mass and inertia of ``body``."""
        body.explicitinertial = True
        body.mass = inertia.mass_kg
        body.ipos = inertia.centre_m
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.tensor_kg_m2
        body.fullinertia = [xx, yy, zz, xy, xz, yz]

    def add_surface(
        self, body: Any, mesh: SurfaceMesh, collision: Collision, friction: float, what: str
    ) -> None:
        """Add the convex parts of ``mesh``, which is in the body's frame."""
        for corners in convex_parts(mesh, collision, what):
            name = f"part{self._meshes}"
            self._meshes += 1
            self.spec.add_mesh(name=name, uservert=(M_PER_MM * corners).ravel())
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=name,
                mass=0.0,
                condim=3,
                friction=[friction, 0.005, 0.0001],
                solref=CONTACT_SOLREF,
                solimp=CONTACT_SOLIMP,
            )


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


class TissueMotion:
    """Poses of one structure over time: those of `BreathingBody`, then the shifts.

    Plain arrays and MuJoCo's quaternions: a world asks at every step.
    """

    def __init__(self, entry: TissueEntry, breathing: BreathingEntry) -> None:
        self._entry = entry
        self._breathing = Breathing(breathing.held_until_s, breathing.frequency_hz)
        self._rest = quaternion_wxyz(entry.rest.rotation)
        self._turn_rad = float(np.linalg.norm(entry.breath_turn_rad))
        self._axis = entry.breath_turn_rad / (self._turn_rad or 1.0)

    def at(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Position (3,) in mm and quaternion (4,), w first, of the structure in the world."""
        depth = self._breathing.depth(time_s)
        position = self._entry.rest.translation_mm + depth * self._entry.breath_shift_mm
        for each in self._entry.shifts:
            share = (time_s - each.start_s) / (each.end_s - each.start_s)
            share = min(max(share, 0.0), 1.0)
            position = position + (share * share * (3.0 - 2.0 * share)) * each.shift_mm
        turn, quaternion = np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, self._axis, depth * self._turn_rad)
        mujoco.mju_mulQuat(quaternion, self._rest, turn)
        return position, quaternion
