"""The tracker of a world: what a session may know of it."""

from collections import deque

import numpy as np

from app.geometry import Stamp, TrackedTransform, TrackingStatus
from app.simulation.state import WorldState
from app.simulation.world_entries import TrackerEntry
from app.synthetic.tracker import Jitter

TRACKER_FRAME = "tracker"
"""The tracker's frame: the axes of the world."""


class SimulatedTracker:
    """Samples of the tracked bodies: at a rate, with errors, and some time later.

    The same seed and states give the same samples.
    """

    def __init__(self, entry: TrackerEntry, seed: int) -> None:
        self._entry = entry
        self._jitter = Jitter(entry.position_rms_mm, entry.angle_rms_rad)
        self._random = np.random.default_rng((seed, 1))
        self._next_ns = 0
        self._waiting: deque[tuple[int, tuple[TrackedTransform, ...]]] = deque()

    def observe(self, state: WorldState) -> None:
        """Take a sample of ``state`` if one is due; call it with every state."""
        if state.time_ns < self._next_ns:
            return
        self._next_ns += self._entry.period_ns
        sample = tuple(
            TrackedTransform(
                self._jitter.measured(
                    state.bodies[name].renamed(target=TRACKER_FRAME), self._random
                ),
                Stamp(state.time_ns),
                TrackingStatus.OK,
            )
            for name in self._entry.tracked
        )
        self._waiting.append((state.time_ns + self._entry.latency_ns, sample))

    def arrived(self, now_ns: int) -> tuple[tuple[TrackedTransform, ...], ...]:
        """The samples that have arrived since the last call, each with one stamp."""
        found = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            found.append(self._waiting.popleft()[1])
        return tuple(found)
