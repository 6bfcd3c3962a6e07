"""A stiff half-axis along the nearest plane's normal, for an arm that closes the loop itself.

The arm (dVRK: ``servo_ci``) pulls its tip back where it is beyond the plane, with ``K`` times the
depth and ``B`` times the speed, and leaves all other motion free.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.fixture import PassivityError, PlainConstraint
from app.geometry import FloatArray, InputError, Transform


@dataclass(frozen=True, slots=True)
class ImpedanceParameters:
    """The half-axis, and the loop of the arm that renders it.

    ``period_s`` is the period of the arm's own loop, ``arm_damping_n_s_m`` the physical damping of
    the arm at its tip. Raises `InputError`, and `PassivityError` unless ``K T / 2 + B < b``
    (Colgate and Schenkel 1997, with the virtual damping B).
    """

    stiffness_n_m: float
    damping_n_s_m: float
    period_s: float
    arm_damping_n_s_m: float

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            is_valid = math.isfinite(value) and (
                value > 0 or (name == "damping_n_s_m" and not value)
            )
            if not is_valid:
                raise InputError(f"{name} of the impedance is {value}; expected more than 0")
        needed = 0.5 * self.stiffness_n_m * self.period_s + self.damping_n_s_m
        if not needed < self.arm_damping_n_s_m:
            raise PassivityError(
                f"the impedance needs a damping of {needed:.4g} N s/m (stiffness times half a "
                f"period, and its own damping); expected below arm_damping_n_s_m "
                f"({self.arm_damping_n_s_m:.4g}), or the arm gives out energy"
            )


@dataclass(frozen=True, slots=True, eq=False)
class HalfAxis:
    """Allowed is the side of ``point_mm`` (3,) to which the unit ``normal`` (3,) points."""

    point_mm: FloatArray
    normal: FloatArray

    @property
    def rotation(self) -> FloatArray:
        """Axes (3, 3) whose z axis is the normal."""
        other = np.eye(3)[int(np.abs(self.normal).argmin())]
        x = np.cross(other, self.normal)
        x = x / np.linalg.norm(x)
        return np.column_stack([x, np.cross(self.normal, x), self.normal])


def half_axis(
    constraint: PlainConstraint, rule_from_base: Transform, tip_mm: FloatArray
) -> HalfAxis:
    """The plane of ``constraint`` with the smallest clearance, for the tip ``tip_mm`` (3,).

    The result and the tip are in the arm's base. ``constraint`` has to be one that the rule
    accepts. The plane is moved from the tool's own point to the tip.
    """
    clearances = (
        np.einsum("ij,ij->i", constraint.normals, constraint.points_on_tool_mm)
        - constraint.offsets_mm
    )
    nearest = int(clearances.argmin())
    normal = rule_from_base.rotation.T @ constraint.normals[nearest]
    return HalfAxis(tip_mm - clearances[nearest] * normal, normal / np.linalg.norm(normal))
