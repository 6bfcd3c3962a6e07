"""Hands that push a tool: by a script, a joystick or 3D mouse, keys, and a haptic device.

Their force acts on the tool's origin along the axes of the world. That of a person ends by itself
when no input comes; it is thread-safe, because input arrives in another thread.

A haptic device is coupled to the tool by a spring, inside the device's passivity bound. The force
on the tool is ``K (s h - x)`` for handle h and tool x, both from where they were when they were
coupled, and the one on the handle ``-s`` times that. A sampled spring returns energy, which the
damping of the device has to take: ``s^2 K (T / 2 + t_d) < b`` (Colgate and Schenkel, Passivity of a
Class of Sampled-Data Systems: Application to Haptic Interfaces, J. Robotic Systems 1997, without
virtual damping, and with the delay t_d). A limited force is a softer spring.
"""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from app.fixture import PassivityError
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, InputError
from app.simulation.state import WorldState, Wrench

if TYPE_CHECKING:
    from app.simulation.world_hand import HandEntry, JoyEntry, Push

FULL_FORCE_MM = 5.0
"""Within this distance of the point that it pushes at, the force falls to 0."""

NEAR_MM = 0.5
"""Nearer to the point that it retreats from, the hand pulls upward: +z of the world."""
JOY_LIFETIME_NS = 200 * NS_PER_MS
"""Without a message for as long the force is 0: joy_node repeats the axes every 50 ms."""
KEY_LIFETIME_NS = 600 * NS_PER_MS
"""A key pushes for as long: terminals repeat a held key after 500 ms, and report no release."""
KEYS = {
    "d": (1.0, 0.0, 0.0),
    "a": (-1.0, 0.0, 0.0),
    "w": (0.0, 1.0, 0.0),
    "s": (0.0, -1.0, 0.0),
    "r": (0.0, 0.0, 1.0),
    "f": (0.0, 0.0, -1.0),
}
"""Key -> direction of its force in the world; any other key ends the force."""
_M_PER_MM = 1e-3


class ScriptedHand:
    """The force of the hand on the origin of the tool ``tool``, which is its tip."""

    def __init__(self, entry: "HandEntry", tool: str) -> None:
        self._entry = entry
        self.tool = tool

    @property
    def admittance_mm_s_n(self) -> float:
        """Speed of the tool per force in free space, for the controller."""
        return self._entry.free_speed_mm_s / self._entry.force_n

    def wrench(self, state: WorldState) -> Wrench:
        """The hand's wrench on the tool in ``state``; 0 between the pushes."""
        time_s = state.time_ns / NS_PER_S
        if self._entry.period_s is not None:
            time_s %= self._entry.period_s
        push = next((p for p in self._entry.pushes if p.start_s <= time_s < p.end_s), None)
        return Wrench(np.zeros(3) if push is None else self._force(push, state), np.zeros(3))

    def _force(self, push: "Push", state: WorldState) -> FloatArray:
        way = state.bodies[push.towards].translation_mm - state.bodies[self.tool].translation_mm
        distance = float(np.linalg.norm(way))
        if not push.retreat:
            return np.asarray(self._entry.force_n / max(distance, FULL_FORCE_MM) * way)
        if distance < NEAR_MM:
            return np.array([0.0, 0.0, self._entry.force_n])
        return np.asarray(-self._entry.force_n / distance * way)


class _ManualHand:
    """A force that lasts for ``lifetime_ns`` of ``clock_ns``."""

    def __init__(self, tool: str, lifetime_ns: int, clock_ns: Callable[[], int]) -> None:
        self.tool = tool
        self._lifetime_ns, self._clock_ns = lifetime_ns, clock_ns
        self._lock = threading.Lock()
        self._force: tuple[FloatArray, int] | None = None

    def wrench(self, state: WorldState) -> Wrench:
        """The force of the last input; 0 once it is too old."""
        with self._lock:
            force = self._force
        if force is None or self._clock_ns() - force[1] > self._lifetime_ns:
            return Wrench(np.zeros(3), np.zeros(3))
        return Wrench(force[0], np.zeros(3))

    def _push(self, force_n: FloatArray | None) -> None:
        with self._lock:
            self._force = None if force_n is None else (force_n, self._clock_ns())


class JoyHand(_ManualHand):
    """The axes of ``sensor_msgs/Joy``, from -1 to 1, times ``force_n``."""

    def __init__(
        self, entry: "JoyEntry", tool: str, force_n: float, clock_ns: Callable[[], int]
    ) -> None:
        super().__init__(tool, JOY_LIFETIME_NS, clock_ns)
        self._entry, self._force_n = entry, force_n

    def take(self, axes: Sequence[float]) -> str:
        """Use ``axes``; returns why they cannot be used, and then the force is 0."""
        needed = max(self._entry.axes)
        if len(axes) <= needed:
            self._push(None)
            return f"{len(axes)} axes; expected at least {needed + 1}"
        mapping = zip(self._entry.axes, self._entry.signs, strict=True)
        values = [sign * axes[each] for each, sign in mapping]
        if not all(math.isfinite(each) for each in values):
            self._push(None)
            return f"axes are {values}; expected finite numbers"
        share = np.clip(values, -1.0, 1.0)
        length = float(np.linalg.norm(share))
        if length <= self._entry.dead:
            self._push(np.zeros(3))
            return ""
        left = min((length - self._entry.dead) / (1.0 - self._entry.dead), 1.0)
        self._push(self._force_n * left / length * share)
        return ""


class KeyHand(_ManualHand):
    """Keys of a terminal, see `KEYS`."""

    def __init__(self, tool: str, force_n: float, clock_ns: Callable[[], int]) -> None:
        super().__init__(tool, KEY_LIFETIME_NS, clock_ns)
        self._force_n = force_n

    def press(self, key: str) -> None:
        """Push along the direction of ``key``; any other key ends the force."""
        direction = KEYS.get(key.lower())
        self._push(None if direction is None else self._force_n * np.array(direction))


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
