"""Desired twist of a cooperatively held tool: the hand's wrench times a gain.

The steady-hand law (Taylor et al., A Steady-Hand Robotic System for Microsurgical Augmentation,
IJRR 1999), with the response of a virtual mass, so that a noisy wrench gives a smooth twist.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.geometry import NS_PER_S, FloatArray, InputError


@dataclass(frozen=True, slots=True)
class AdmittanceGains:
    """Twist per wrench: ``linear_mm_s_n`` in mm/s/N, ``angular_rad_s_nm`` in rad/s/(N m).

    Forces below ``dead_n`` and torques below ``dead_n_m`` count as 0, and larger ones less that.
    ``response_s`` is the time constant with which the twist follows. Raises `InputError`.
    """

    linear_mm_s_n: float = 10.0
    angular_rad_s_nm: float = 1.0
    dead_n: float = 0.1
    dead_n_m: float = 0.005
    response_s: float = 0.03

    def __post_init__(self) -> None:
        for name in ("linear_mm_s_n", "angular_rad_s_nm", "dead_n", "dead_n_m", "response_s"):
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
        goal = np.concatenate(
            [
                gains.linear_mm_s_n * _above(force_n, gains.dead_n),
                gains.angular_rad_s_nm * _above(torque_n_m, gains.dead_n_m),
            ]
        )
        if self._last_ns is None or now_ns < self._last_ns:
            self._twist = np.zeros(6)
        else:
            step_s = (now_ns - self._last_ns) / NS_PER_S
            share = 1.0 if gains.response_s == 0.0 else -math.expm1(-step_s / gains.response_s)
            self._twist = self._twist + share * (goal - self._twist)
        self._last_ns = now_ns
        return self._twist.copy()


def _above(vector: FloatArray, dead: float) -> FloatArray:
    """``vector`` (3,) shortened by ``dead``, 0 where it is not longer."""
    length = math.hypot(*np.asarray(vector, dtype=np.float64).tolist())
    return np.asarray(vector) * (max(length - dead, 0.0) / length if length > 0.0 else 0.0)
