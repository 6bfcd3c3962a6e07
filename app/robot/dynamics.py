"""Masses of links and the drives of joints, as a robot file states them, for simulation.

Kinematics do not need them: values that cannot be simulated, such as a mass of 0, are kept as they
are in the file; `app.simulation` refuses them.
"""

import math
from dataclasses import dataclass

from app.geometry import FloatArray, Transform


@dataclass(frozen=True, slots=True, eq=False)
class LinkInertia:
    """Mass in kg and where it is.

    ``link_from_inertial`` (mm) is the frame of the centre of mass. ``tensor_kg_m2`` (3, 3) is about
    that centre, in the axes of that frame; None where the file gives a mass alone (AMBF).
    """

    mass_kg: float
    link_from_inertial: Transform
    tensor_kg_m2: FloatArray | None


@dataclass(frozen=True, slots=True)
class JointDynamics:
    """Limits of a joint's drive, and its losses, in N m and rad (N and m for sliding joints).

    ``effort`` and ``velocity`` are the largest of the drive, None where the file gives none.
    """

    effort: float | None = None
    velocity: float | None = None
    damping: float = 0.0
    friction: float = 0.0

    @property
    def is_finite(self) -> bool:
        """True if no value is infinite or NaN."""
        values = (self.effort, self.velocity, self.damping, self.friction)
        return all(value is None or math.isfinite(value) for value in values)
