"""Hands that a person moves: axes of a joystick or 3D mouse, and keys.

Their force acts on the tool's origin along the axes of the world, as that of the scripted hand, and
ends by itself when no input comes. Thread-safe: input arrives in another thread.
"""

import math
import threading
from collections.abc import Callable, Sequence

import numpy as np

from app.geometry import NS_PER_MS, FloatArray
from app.simulation.state import WorldState, Wrench
from app.simulation.world_hand import JoyEntry

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
        self, entry: JoyEntry, tool: str, force_n: float, clock_ns: Callable[[], int]
    ) -> None:
        super().__init__(tool, JOY_LIFETIME_NS, clock_ns)
        self._entry, self._force_n = entry, force_n

    def take(self, axes: Sequence[float]) -> str:
        """Use ``axes``; returns why they cannot be used, and then the force is 0."""
        needed = max(self._entry.axes)
        if len(axes) <= needed:
            self._push(None)
            return f"{len(axes)} axes; expected at least {needed + 1}"
        values = [sign * axes[each] for each, sign in zip(*self._mapping(), strict=True)]
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

    def _mapping(self) -> tuple[tuple[int, ...], tuple[float, ...]]:
        return self._entry.axes, self._entry.signs


class KeyHand(_ManualHand):
    """Keys of a terminal, see `KEYS`."""

    def __init__(self, tool: str, force_n: float, clock_ns: Callable[[], int]) -> None:
        super().__init__(tool, KEY_LIFETIME_NS, clock_ns)
        self._force_n = force_n

    def press(self, key: str) -> None:
        """Push along the direction of ``key``; any other key ends the force."""
        direction = KEYS.get(key.lower())
        self._push(None if direction is None else self._force_n * np.array(direction))
