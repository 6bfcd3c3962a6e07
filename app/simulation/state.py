"""The true state of a world at one time, and what its tracker lets a session know of it."""

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.geometry import NS_PER_S, FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.robot.kinematic_tree import LinkPoses
from app.simulation.command_gate import ArmCommand, ArmStatus
from app.synthetic.simulated_tracker import Metal, Reading, SimulatedTracker

if TYPE_CHECKING:
    from app.simulation.world_entries import TrackerEntry

TRACKER_FRAME = "tracker"
"""The tracker's frame: the axes of the world."""
_LONG_S = 1e6
Samples = tuple[TrackedTransform, ...]


@dataclass(frozen=True, slots=True, eq=False)
class ArmState:
    """Actuated joints (n,) in the order of the robot's file, in rad, rad/s, N m (m, m/s, N).

    ``setpoints`` are the velocities that the drives follow; 0 while they exert a wrench.
    ``command`` is the one that the arm follows, None while it stands.
    ``links`` has the pose of each link in the world, without links that have no body of their own.
    ``fault``: why the status is FAULT.
    """

    joints: tuple[str, ...]
    positions: FloatArray
    velocities: FloatArray
    efforts: FloatArray
    setpoints: FloatArray
    status: ArmStatus
    fault: str
    links: LinkPoses
    command: ArmCommand | None = None

    @property
    def is_busy(self) -> bool:
        """True while the arm follows a command."""
        return self.command is not None


@dataclass(frozen=True, slots=True, eq=False)
class WorldState:
    """Arms by name, and ``bodies``: poses in the world of tools, bodies and tissues by name."""

    time_ns: int
    arms: Mapping[str, ArmState]
    bodies: Mapping[str, Transform]


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """Two bodies that overlap by ``depth_mm`` (negative: a gap) at ``point_mm`` (3,)."""

    bodies: tuple[str, str]
    depth_mm: float
    point_mm: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """Force (3,) in N at the origin of a body and torque (3,) in N m, in the world's axes."""

    force_n: FloatArray
    torque_n_m: FloatArray


class WorldTracker:
    """Measures the tracked bodies with the errors of a `TrackerModel`.

    A sample is acquired at the first state at or after its time, and arrives at its stamp, which is
    late by the model's latency. The same seed and states give the same samples.
    """

    def __init__(self, entry: "TrackerEntry", seed: int) -> None:
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
