"""Counts the content of a recording, frame by frame."""

from collections import Counter
from dataclasses import dataclass, field

from app.case.frames.samples import TrackingFrame
from app.geometry import NS_PER_S, TrackingStatus


@dataclass(slots=True)
class EdgeCount:
    """Number of samples of ``source`` in ``target``, by status."""

    target: str
    source: str
    statuses: Counter[TrackingStatus] = field(default_factory=Counter)

    @property
    def samples(self) -> int:
        """Samples of any status."""
        return self.statuses.total()

    @property
    def valid(self) -> int:
        """Samples with a pose."""
        return self.statuses[TrackingStatus.OK]


@dataclass(slots=True)
class RecordingInventory:
    """Counts of a recording, filled with `add`. Watchdog frames count as ``silences`` only."""

    frames: int = 0
    silences: int = 0
    joint_samples: int = 0
    joint_names: tuple[str, ...] = ()
    _edges: dict[tuple[str, str], EdgeCount] = field(default_factory=dict)
    _first_ns: int | None = None
    _last_ns: int | None = None

    def add(self, frame: TrackingFrame) -> None:
        """Count one frame."""
        if frame.poses:
            self.frames += 1
        else:
            self.silences += 1
        for sample in frame.poses:
            edge = (sample.target, sample.source)
            self._edges.setdefault(edge, EdgeCount(*edge)).statuses[sample.status] += 1
        for joints in frame.joints:
            self.joint_samples += 1
            self.joint_names = joints.names
        self._first_ns = frame.stamp.ns if self._first_ns is None else self._first_ns
        self._last_ns = frame.stamp.ns

    @property
    def edges(self) -> tuple[EdgeCount, ...]:
        """One entry per measured transform, in the order of first appearance."""
        return tuple(self._edges.values())

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, 0 without frames."""
        if self._first_ns is None or self._last_ns is None:
            return 0.0
        return (self._last_ns - self._first_ns) / NS_PER_S
