"""Tracker frames, joint samples and activations, and streams of them.

Streams are assembled from samples, with gaps filled, read ahead, counted.
"""

from bisect import bisect_left, bisect_right, insort_right
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import islice

import numpy as np

from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    InputError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    freshness_of,
    slot_setters,
)


class Activation(StrEnum):
    """Known state of the energy device; a higher rank prevails in a summary of several moments."""

    OFF = "off"
    UNKNOWN = "unknown"
    ON = "on"

    @property
    def label(self) -> str:
        """Capitals, for displays."""
        return self.value.upper()

    @property
    def symbol(self) -> str:
        """A sign that differs without colour."""
        return {"off": "\N{WHITE CIRCLE}", "unknown": "?", "on": "\N{BLACK CIRCLE}"}[self.value]

    @property
    def rank(self) -> int:
        """Position among the states."""
        return list(Activation).index(self)


class ActivationTrail:
    """Last report of the energy device, on any clock in ns. Not older than ``stale_after_ns``.

    A source that has said nothing, or too long ago, leaves the state unknown: never off.
    """

    def __init__(self, stale_after_ns: int) -> None:
        self._limits = FreshnessLimits(stale_after_ns, future_tolerance_ns=stale_after_ns)
        self._last: tuple[int, bool] | None = None

    def hear(self, on: bool, at_ns: int) -> None:
        """Take what the source says at ``at_ns``; from any thread."""
        self._last = at_ns, on

    def forget(self) -> None:
        """Take that the source cannot be understood; from any thread."""
        self._last = None

    def at(self, now_ns: int) -> Activation:
        """The state at ``now_ns``."""
        last = self._last
        if last is None or freshness_of(last[0], now_ns, self._limits) is not Freshness.VALID:
            return Activation.UNKNOWN
        return Activation.ON if last[1] else Activation.OFF


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """A position for each of the joints ``names``, in rad, or in m for prismatic joints.

    Plain floats, not an array: hundreds of samples arrive per second, and few of them are used.
    """

    names: tuple[str, ...]
    positions: tuple[float, ...]
    stamp: Stamp

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "positions", tuple(map(float, self.positions)))
        if len(self.positions) != len(self.names):
            raise InputError(
                f"joint sample has {len(self.names)} names and {len(self.positions)} positions; "
                "expected one position per name"
            )
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InputError(f"joint {twice!r} is repeated in a joint sample; expected it once")

    @classmethod
    def unchecked(
        cls, names: tuple[str, ...], positions: tuple[float, ...], stamp: Stamp
    ) -> "JointSample":
        """Without checks: from tuples of one length, of unique names and of floats."""
        made = object.__new__(cls)
        _set_names(made, names)
        _set_positions(made, positions)
        _set_stamp(made, stamp)
        return made

    def as_mapping(self) -> dict[str, float]:
        """Positions by joint name."""
        return dict(zip(self.names, self.positions, strict=True))


_set_names, _set_positions, _set_stamp = slot_setters(JointSample)


@dataclass(frozen=True, slots=True, eq=False)
class TrackingFrame:
    """All samples that the tracker acquired at ``stamp``, and the joints read since the last frame.

    ``poses`` holds one sample per edge, of any status. A frame without poses is a watchdog frame:
    the source sent nothing for too long. ``unfiltered_stamp`` is the time by the second clock of an
    IGSIO recording, before its smoothing. ``activation``: None without a source of its state.
    """

    stamp: Stamp
    poses: tuple[TrackedTransform, ...]
    joints: tuple[JointSample, ...] = ()
    unfiltered_stamp: Stamp | None = None
    activation: Activation | None = None


REORDER_NS = 500 * NS_PER_MS
"""Largest delay of a sample that is still sorted into the order of acquisition."""

_MAX_PENDING_JOINTS = 20_000
_MAX_PENDING_FRAMES = 10_000
"""Stamps in the buffer: 20 kHz, which no tracker reaches."""


@dataclass(slots=True)
class _Draft:
    stamp: Stamp
    poses: dict[tuple[str, str], TrackedTransform]
    unfiltered: Stamp | None = None
    activation: Activation | None = None


class FrameAssembler:
    """Groups samples by acquisition stamp, through a buffer that is `REORDER_NS` long.

    A sample older than that counts as a clock that jumped back: all buffered frames are returned
    and the order starts anew, so that the jump stays visible. Joints go with the first frame that
    is not older than they are; the last frame takes the rest. Two samples of an edge with one stamp
    count once where they agree; where they differ the edge is lost. ``activation()`` is that at
    the arrival of the first sample of a frame; None for a recording without it.
    """

    def __init__(
        self, note: Callable[[str], None], activation: Callable[[], Activation] | None = None
    ) -> None:
        self._note = note
        self._activation = activation
        self._drafts: dict[int, _Draft] = {}
        self._order: list[int] = []  # stamps of the drafts, sorted
        self._joints: list[JointSample] = []  # sorted by stamp
        self._joints_dropped = False
        self._contradiction_noted = False
        self._newest_ns: int | None = None

    def add_pose(self, sample: TrackedTransform) -> Iterable[TrackingFrame]:
        """Add a sample; return the frames that are complete now."""
        stamp, edge = sample.stamp, (sample.target, sample.source)
        draft = self._drafts.get(stamp.ns)
        if draft is None:
            finished = self._begin(stamp.ns)
            activation = None if self._activation is None else self._activation()
            self._drafts[stamp.ns] = _Draft(stamp, {edge: sample}, activation=activation)
            insort_right(self._order, stamp.ns)
            return finished
        known = draft.poses.get(edge)
        draft.poses[edge] = sample if known is None else self._agreed(known, sample)
        return ()

    def _begin(self, ns: int) -> list[TrackingFrame]:
        """The frames that are complete once a sample of ``ns`` has arrived."""
        newest = ns if self._newest_ns is None else max(ns, self._newest_ns)
        if ns < newest - REORDER_NS:
            finished = list(self.flush())
            newest = ns
        else:
            complete = bisect_left(self._order, newest - REORDER_NS)
            complete = max(complete, len(self._order) - _MAX_PENDING_FRAMES)
            finished = [self._finished(stamp) for stamp in self._order[:complete]]
            del self._order[:complete]
        self._newest_ns = newest
        return finished

    def _agreed(self, known: TrackedTransform, sample: TrackedTransform) -> TrackedTransform:
        agreed = agreed_sample(known, sample)
        contradicts = known.transform is not None and sample.transform is not None
        if contradicts and agreed is not known and not self._contradiction_noted:
            self._note(
                f"{sample.target} -> {sample.source} has two poses at {sample.stamp.ns} ns: "
                "such samples are INVALID"
            )
            self._contradiction_noted = True
        return agreed

    def add_unfiltered(self, stamp: Stamp, unfiltered: Stamp) -> None:
        """Add the second clock's time of the samples acquired at ``stamp``."""
        draft = self._drafts.get(stamp.ns)
        if draft is not None:
            draft.unfiltered = unfiltered

    def add_joints(self, sample: JointSample) -> Iterable[TrackingFrame]:
        """Add a joint sample, its stamp on the tracker's clock; it completes no frame."""
        if self._joints and sample.stamp.ns < self._joints[-1].stamp.ns:
            insort_right(self._joints, sample, key=_ns)
        else:
            self._joints.append(sample)
        if len(self._joints) > _MAX_PENDING_JOINTS:
            del self._joints[: _MAX_PENDING_JOINTS // 2]
            if not self._joints_dropped:
                self._note(
                    "joint states run far ahead of the tracker, the oldest are skipped: "
                    "clock.offset_robot_to_tracker_ms may be wrong"
                )
            self._joints_dropped = True
        return ()

    def flush(self) -> Iterator[TrackingFrame]:
        """Yield all buffered frames, at the end or after a jump of the clock."""
        stamps, self._order = self._order, []
        for stamp in stamps:
            yield self._finished(stamp, last=stamp == stamps[-1])

    def _finished(self, ns: int, *, last: bool = False) -> TrackingFrame:
        draft = self._drafts.pop(ns)
        count = len(self._joints) if last else bisect_right(self._joints, ns, key=_ns)
        joints = tuple(self._joints[:count])
        del self._joints[:count]
        poses = tuple(draft.poses.values())
        return TrackingFrame(draft.stamp, poses, joints, draft.unfiltered, draft.activation)


def agreed_sample(known: TrackedTransform, sample: TrackedTransform) -> TrackedTransform:
    """Merge two samples of one edge and stamp: INVALID where their poses differ."""
    if known.transform is None:
        return known
    if sample.transform is None:
        return sample
    if np.array_equal(known.transform.matrix, sample.transform.matrix):
        return known
    return TrackedTransform.lost(sample.target, sample.source, sample.stamp, TrackingStatus.INVALID)


def _ns(sample: JointSample) -> int:
    return sample.stamp.ns


def with_watchdog(frames: Iterator[TrackingFrame], stale_after_ns: int) -> Iterator[TrackingFrame]:
    """Yield ``frames``, and one frame without poses in each gap longer than ``stale_after_ns``.

    A replay steps from frame to frame: without the inserted frame its time would stop in a gap and
    the last margin would remain displayed. The watchdog frame is stamped one nanosecond after the
    last frame became stale and takes the joints that were read up to then. The same is done at the
    end, where joints continue after the last frame of the tracker.
    """
    limits = FreshnessLimits(stale_after_ns)
    last_ns: int | None = None
    for frame in frames:
        if last_ns is not None and freshness_of(last_ns, frame.stamp.ns, limits) is Freshness.STALE:
            early, late = _split(frame.joints, last_ns + stale_after_ns + 1)
            yield _watchdog(frame, last_ns + stale_after_ns + 1, early)
            frame = replace(frame, joints=late)
        last_ns = frame.stamp.ns
        before, after = _split(frame.joints, last_ns + stale_after_ns)
        yield replace(frame, joints=before) if after else frame
        if after:
            yield _watchdog(frame, last_ns + stale_after_ns + 1, after)


def _watchdog(
    frame: TrackingFrame, stamp_ns: int, joints: tuple[JointSample, ...]
) -> TrackingFrame:
    activation = None if frame.activation is None else Activation.UNKNOWN
    return TrackingFrame(replace(frame.stamp, ns=stamp_ns), (), joints, activation=activation)


def _split(
    joints: tuple[JointSample, ...], until_ns: int
) -> tuple[tuple[JointSample, ...], tuple[JointSample, ...]]:
    late = [sample for sample in joints if sample.stamp.ns > until_ns]
    if not late:
        return joints, ()
    return tuple(sample for sample in joints if sample.stamp.ns <= until_ns), tuple(late)


# A replay that reads one frame and then steps it is slower by a tenth: reading and stepping evict
# each other's code and data from the processor's caches.

AHEAD = 32
"""Frames per block: two thirds of a second at 50 Hz, read in about 2 ms."""


def read_ahead(frames: Iterator[TrackingFrame]) -> Iterator[TrackingFrame]:
    """Yield ``frames``, read in blocks of `AHEAD`.

    Frames before an error are yielded before it is raised.
    """
    while True:
        block: list[TrackingFrame] = []
        try:
            block.extend(islice(frames, AHEAD))
        except Exception:
            yield from block
            raise
        if not block:
            return
        yield from block


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
