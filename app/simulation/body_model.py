"""Bodies, surfaces and masses as elements of a MuJoCo model; metres here, mm outside."""

from typing import Any

import mujoco
import numpy as np

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.simulation.convex_parts import convex_parts
from app.simulation.inertia import M_PER_MM, Inertia
from app.simulation.world_entries import Collision

CONTACT_SOLREF = (0.002, 1.0)
CONTACT_SOLIMP = (0.99, 0.999, 0.0001, 0.5, 2.0)
"""Contacts: time constant of 2 ms, critically damped; nearly rigid from 0.1 mm of overlap."""


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
