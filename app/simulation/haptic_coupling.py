"""A spring between the handle of a haptic device and a tool, inside the device's passivity bound.

The force on the tool is ``K (s h - x)`` for handle h and tool x, both from where they were when
they were coupled, and the one on the handle ``-s`` times that. A sampled spring returns energy,
which the damping of the device has to take: ``s^2 K (T / 2 + t_d) < b`` (Colgate and Schenkel,
Passivity of a Class of Sampled-Data Systems: Application to Haptic Interfaces, J. Robotic Systems
1997, without virtual damping, and with the delay t_d). A limited force is a softer spring.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.fixture import PassivityError
from app.geometry import FloatArray, InputError

_M_PER_MM = 1e-3


@dataclass(frozen=True, slots=True)
class HapticParameters:
    """The spring, and the device that renders it.

    ``stiffness_n_m`` is at the tool, ``scale`` the way of the tool per way of the handle,
    ``force_n`` the largest force on the tool. ``period_s`` and ``delay_s`` are those of the loop
    from the handle's pose to its force, ``damping_n_s_m`` is the physical damping of the handle.
    Raises `InputError`, and `PassivityError` for a spring that is too stiff.
    """

    stiffness_n_m: float
    force_n: float
    scale: float
    period_s: float
    delay_s: float
    damping_n_s_m: float

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            is_valid = math.isfinite(value) and (value > 0.0 or (name == "delay_s" and value == 0))
            if not is_valid:
                raise InputError(f"{name} of the haptic device is {value}; expected more than 0")
        if not self.stiffness_n_m < self.max_stiffness_n_m:
            raise PassivityError(
                f"stiffness_n_m of the haptic device is {self.stiffness_n_m:.4g}; expected below "
                f"{self.max_stiffness_n_m:.4g} for its damping, scale, period and delay, or it "
                "gives out energy"
            )

    @property
    def max_stiffness_n_m(self) -> float:
        """The bound at the tool: b / (s^2 (T / 2 + t_d))."""
        return self.damping_n_s_m / (self.scale**2 * (0.5 * self.period_s + self.delay_s))

    @property
    def max_period_s(self) -> float:
        """The longest period for which this spring is passive."""
        return 2.0 * (self.damping_n_s_m / (self.scale**2 * self.stiffness_n_m) - self.delay_s)


class HapticCoupling:
    """The spring, relaxed at the first `update` and at the first one after `release`."""

    def __init__(self, parameters: HapticParameters) -> None:
        self.parameters = parameters
        self._origin: tuple[FloatArray, FloatArray] | None = None

    @property
    def is_coupled(self) -> bool:
        """True between an update and the next release."""
        return self._origin is not None

    def release(self) -> None:
        """Let go of the tool; it is taken at its place at the next update."""
        self._origin = None

    def update(self, handle_mm: FloatArray, tool_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces (3,) in N on the tool and on the handle; positions (3,) in the same axes."""
        given = self.parameters
        if self._origin is None:
            self._origin = np.array(handle_mm, dtype=float), np.array(tool_mm, dtype=float)
        handle_from, tool_from = self._origin
        ahead = given.scale * (handle_mm - handle_from) - (tool_mm - tool_from)
        force = _M_PER_MM * given.stiffness_n_m * ahead
        length = float(np.linalg.norm(force))
        force = force * min(1.0, given.force_n / length) if length > 0.0 else force
        return force, -given.scale * force
