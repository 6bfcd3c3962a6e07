"""Compliance of a held tool: the hand's admittance, and the half-axis of an arm's impedance.

The admittance is the steady-hand law (Taylor et al., A Steady-Hand Robotic System for Microsurgical
Augmentation, IJRR 1999), with the response of a virtual mass, so that a noisy wrench gives a smooth
twist. The half-axis is for an arm that closes the loop itself: the arm (dVRK: ``servo_ci``) pulls
its tip back where it is beyond the nearest plane, with ``K`` times the depth and ``B`` times the
speed, and leaves all other motion free.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from app.files.keys import Number
from app.fixture import PassivityError, PlainConstraint
from app.geometry import NS_PER_S, FloatArray, InputError, Transform


@dataclass(frozen=True, slots=True)
class AdmittanceGains:
    """Twist per wrench: ``linear_mm_s_n`` in mm/s/N, ``angular_rad_s_nm`` in rad/s/(N m).

    Forces below ``dead_n`` and torques below ``dead_n_m`` count as 0, and larger ones less that.
    ``response_s`` is the time constant with which the twist follows. Raises `InputError`.
    """

    linear_mm_s_n: Annotated[float, Number("speed per force", default=10.0, minimum=0.0)] = 10.0
    angular_rad_s_nm: Annotated[
        float, Number("angular speed per torque", default=1.0, minimum=0.0)
    ] = 1.0
    dead_n: Annotated[float, Number("smaller forces count as 0", default=0.1, minimum=0.0)] = 0.1
    dead_n_m: Annotated[float, Number("smaller torques count as 0", default=0.005, minimum=0.0)] = (
        0.005
    )
    response_s: Annotated[
        float,
        "response_ms",
        Number("time constant of the response", default=30.0, minimum=0.0),
    ] = 0.03

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} of the admittance is {value}; expected at least 0")


class HandAdmittance:
    """State of the admittance of one hand: the twist that it desires."""

    def __init__(self, gains: AdmittanceGains) -> None:
        self._gains = gains
        self._last_ns: int | None = None
        self._twist: FloatArray = np.zeros(6)

    def reset(self) -> None:
        """Forget the motion; the next twist is 0."""
        self._last_ns, self._twist = None, np.zeros(6)

    def twist(self, force_n: FloatArray, torque_n_m: FloatArray, now_ns: int) -> FloatArray:
        """The desired twist (6,) at ``now_ns``: mm/s, then rad/s, in the axes of the wrench."""
        gains = self._gains
        goal = np.array(
            _above(force_n, gains.dead_n, gains.linear_mm_s_n)
            + _above(torque_n_m, gains.dead_n_m, gains.angular_rad_s_nm)
        )
        if self._last_ns is None or now_ns < self._last_ns:
            self._twist = np.zeros(6)
        else:
            step_s = (now_ns - self._last_ns) / NS_PER_S
            share = 1.0 if gains.response_s == 0.0 else -math.expm1(-step_s / gains.response_s)
            self._twist = self._twist + share * (goal - self._twist)
        self._last_ns = now_ns
        return self._twist.copy()


def _above(vector: FloatArray, dead: float, gain: float) -> list[float]:
    """``gain`` times ``vector`` (3,) shortened by ``dead``, 0 where it is not longer."""
    values = np.asarray(vector, dtype=np.float64).tolist()
    length = math.hypot(*values)
    share = gain * max(length - dead, 0.0) / length if length > 0.0 else 0.0
    return [share * value for value in values]


# The arm (dVRK: ``servo_ci``) pulls its tip back where it is beyond the plane, with ``K`` times
# the depth and ``B`` times the speed, and leaves all other motion free.


@dataclass(frozen=True, slots=True)
class ImpedanceParameters:
    """The half-axis, and the loop of the arm that renders it.

    ``period_s`` is the period of the arm's own loop, ``arm_damping_n_s_m`` the physical damping of
    the arm at its tip. Raises `InputError`, and `PassivityError` unless ``K T / 2 + B < b``
    (Colgate and Schenkel 1997, with the virtual damping B).
    """

    stiffness_n_m: Annotated[float, Number("beyond the plane, along its normal", above=0.0)]
    damping_n_s_m: Annotated[float, Number("the same per speed", minimum=0.0)]
    period_s: Annotated[
        float, "period_ms", Number("period of the arm's own loop", above=0.0, maximum=20.0)
    ]
    arm_damping_n_s_m: Annotated[float, Number("physical damping of the arm at its tip", above=0.0)]

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
