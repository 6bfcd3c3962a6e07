"""Breathing, which moves the chest reference a little and the breast with its tumour more.

The patient is ventilated. During registration the breath is held at end expiration, where every
body is at its rest pose; then breathing starts.
"""

from dataclasses import dataclass

import numpy as np

from app.geometry import FloatArray, Transform
from app.geometry.rotations import rotation_of_vector
from app.synthetic.poses import Poses


@dataclass(frozen=True, slots=True)
class Breathing:
    """Depth of breath over time: 0 at end expiration, 1 at full inspiration.

    ``sin^4(pi f t)``: the model of Lujan et al. 1999 with n = 2, which dwells at end expiration.
    Until ``held_until_s`` the breath is held there.
    """

    held_until_s: float
    frequency_hz: float = 0.25

    def depth(self, time_s: float) -> float:
        """Depth of breath at ``time_s``, 0 to 1."""
        since_s = max(time_s - self.held_until_s, 0.0)
        return float(np.sin(np.pi * self.frequency_hz * since_s) ** 4)

    def depths(self, times_s: FloatArray) -> FloatArray:
        """Depths of breath (n,) at ``times_s`` (n,)."""
        since_s = np.maximum(times_s - self.held_until_s, 0.0)
        # The power of an array has other rounding than that of a number.
        return np.array([sine**4 for sine in np.sin(np.pi * self.frequency_hz * since_s)])


@dataclass(frozen=True, slots=True, eq=False)
class BreathingBody:
    """A body that breathing moves: its rest pose, and its displacement at full inspiration.

    ``shift_mm`` (3,) is in the rest pose's target frame; ``turn_rad`` (3,) is a rotation vector
    about the body's own origin.
    """

    rest: Transform
    shift_mm: FloatArray
    turn_rad: FloatArray

    def at(self, depth: float) -> Transform:
        """The pose at a depth of breath of 0 to 1."""
        turn = rotation_of_vector(depth * self.turn_rad)
        return Transform.unchecked(
            self.rest.target,
            self.rest.source,
            self.rest.rotation @ turn,
            self.rest.translation_mm + depth * self.shift_mm,
        )

    def at_all(self, depths: FloatArray) -> Poses:
        """The poses at n depths of breath (n,)."""
        turns = np.array([rotation_of_vector(turn) for turn in depths[:, None] * self.turn_rad])
        return Poses(
            self.rest.target,
            self.rest.source,
            np.matmul(self.rest.rotation, turns),
            self.rest.translation_mm + depths[:, None] * self.shift_mm,
        )
