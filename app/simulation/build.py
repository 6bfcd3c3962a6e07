"""Builds the MuJoCo model of a world."""

from dataclasses import dataclass
from typing import Any

import mujoco

from app.geometry import MarginGuardError
from app.simulation.body_model import BodyWriter
from app.simulation.errors import WorldError
from app.simulation.inertia import of_hulls
from app.simulation.robot_model import RobotModel, add_robot
from app.simulation.world_entries import WorldDescription

NS_TO_S = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class BuiltWorld:
    """The compiled model; ``bodies`` are the names of tools, bodies and tissues."""

    model: Any
    robots: tuple[RobotModel, ...]
    bodies: tuple[str, ...]


def build_world(description: WorldDescription) -> BuiltWorld:
    """Compile ``description``. Raises `WorldError` for what cannot be simulated."""
    spec = mujoco.MjSpec()
    spec.modelname = description.name
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    spec.compiler.fusestatic = False
    spec.option.timestep = NS_TO_S * description.timestep_ns
    spec.option.gravity = [0.0, 0.0, -description.gravity_m_s2]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    # A diverged state is an error and not silently the initial one.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    writer = BodyWriter(spec)
    try:
        robots = tuple(add_robot(writer, entry) for entry in description.robots)
        bodies = [each.tool.name for each in description.robots if each.tool is not None]
        for body in description.bodies:
            inertia = None
            if body.mass_kg is not None:
                what = f"body {body.name!r}"
                inertia = of_hulls([body.mesh.vertices_mm], what, mass_kg=body.mass_kg)
            writer.add_body(
                writer.world,
                body.name,
                body.world_from_body,
                body.mesh,
                body.collision,
                body.friction,
                inertia=inertia,
                is_free=body.mass_kg is not None,
                is_driven=body.mass_kg is None,  # so that it can be moved while the world runs
            )
            bodies.append(body.name)
        for tissue in description.tissues:
            writer.add_body(
                writer.world, tissue.name, tissue.rest, tissue.mesh, "none", 0.0, is_driven=True
            )
            bodies.append(tissue.name)
        return BuiltWorld(spec.compile(), robots, tuple(bodies))
    except WorldError:
        raise
    except MarginGuardError as error:
        raise WorldError(f"world {description.name!r}: {error}") from error
    except ValueError as error:  # of MuJoCo's compiler
        raise WorldError(f"world {description.name!r} does not compile: {error}") from error
