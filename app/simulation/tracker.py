"""The tracker of a world: what a session may know of it."""

from collections import deque
from collections.abc import Iterator

from app.geometry import NS_PER_S, Stamp, TrackedTransform, TrackingStatus, Transform
from app.simulation.state import WorldState
from app.simulation.world_entries import TrackerEntry
from app.synthetic.simulated_tracker import Metal, Reading, SimulatedTracker

TRACKER_FRAME = "tracker"
"""The tracker's frame: the axes of the world."""

_LONG_S = 1e6

Samples = tuple[TrackedTransform, ...]


class WorldTracker:
    """Measures the tracked bodies with the errors of a `TrackerModel`.

    A sample is acquired at the first state at or after its time, and arrives at its stamp, which is
    late by the model's latency. The same seed and states give the same samples.
    """

    def __init__(self, entry: TrackerEntry, seed: int) -> None:
        self._entry = entry
        self._tracker = SimulatedTracker(entry.model, (seed, 1))
        self._readings: Iterator[Reading] = self._tracker.readings(_LONG_S)
        self._next = next(self._readings)
        self._last: dict[str, Transform] = {}
        self._waiting: deque[tuple[int, Samples]] = deque()

    def observe(self, state: WorldState) -> None:
        """Acquire a sample of ``state`` if one is due; call it with every state."""
        reading = self._next
        if state.time_ns < reading.acquired_ns:
            return
        self._next = next(self._readings)
        if not reading.repeated:
            metal = self._metal(state)
            for name in self._entry.tracked:
                truth = state.bodies[name].renamed(target=TRACKER_FRAME)
                self._last[name] = self._tracker.measure(
                    name, truth, state.time_ns / NS_PER_S, metal
                )
        samples = tuple(self._sample(name, Stamp(reading.stamp_ns)) for name in self._last)
        if not reading.skipped:
            self._waiting.append((reading.stamp_ns, samples))

    def arrived(self, now_ns: int) -> tuple[Samples, ...]:
        """The samples that have arrived since the last call, each with one stamp."""
        found = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            found.append(self._waiting.popleft()[1])
        return tuple(found)

    def _sample(self, name: str, stamp: Stamp) -> TrackedTransform:
        if self._tracker.loses():
            return TrackedTransform.lost(TRACKER_FRAME, name, stamp, TrackingStatus.INVALID)
        return TrackedTransform(self._last[name], stamp, TrackingStatus.OK)

    def _metal(self, state: WorldState) -> Metal | None:
        """The arm, which distorts the field of an electromagnetic tracker."""
        if self._entry.metal is None:
            return None
        arm, start, end = self._entry.metal
        links = state.arms[arm].links
        return Metal(links[start].translation_mm, links[end].translation_mm)
