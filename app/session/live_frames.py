"""Grouping of the samples of a live source into the frames that a session steps through."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from app.case import JointSample, TrackingFrame, agreed_sample
from app.geometry import NS_PER_MS, NS_PER_S, Edge, Stamp, TrackedTransform, shortest_path
from app.session.live_queues import AuxiliarySamples, JointQueue, RecentSamples
from app.session.named_frames import missing_frames_problem, nothing_received_problem, path_to_base
from app.session.setup import SessionSetup

_DRIFT_PER = 5_000
DRIFT = 1.0 / _DRIFT_PER
"""Largest drift between two crystal clocks, in seconds per second (200 ppm)."""

CONFIRMED_WITHIN_NS = 20 * NS_PER_MS
"""An offset that is lower than the estimate by less than this is accepted at once."""

CONFIRMED_BY = 3
"""Number of samples with different stamps that together replace any earlier estimate."""

REMEMBERED_NS = 10 * NS_PER_S
"""Time for which an unconfirmed sample waits for others that confirm it."""

MAX_UNCONFIRMED = 64
"""Most unconfirmed samples at once; beyond it the earliest arrival is dropped."""


class SourceClock:
    """Estimates the present on the clock of a source that differs from the host's.

    A sample that arrives at ``host_ns`` with the stamp ``ns`` gives ``host_ns - ns``: the offset of
    the two clocks plus the sample's latency. The smallest value has the lowest latency and is the
    estimate of the offset. The estimate may grow by `DRIFT` only, so that growing latency appears
    as age and not as an offset. The lowest latency itself cannot be observed.

    One wrong stamp far ahead would make all other samples look old until the drift has compensated
    it. An offset that is lower by more than `CONFIRMED_WITHIN_NS` is therefore accepted only when
    `CONFIRMED_BY` samples with different stamps agree on it within that bound and within
    `REMEMBERED_NS`; until then such a sample is from the future. The first offset needs the same
    confirmation, and no time is known before it. The present never goes back, except by `restart`.

    With ``stamps_of_host`` the two clocks are the same and nothing is estimated.
    """

    def __init__(self, *, stamps_of_host: bool) -> None:
        self._stamps_of_host = stamps_of_host
        # Offset minus the drift allowed since host time 0, so that offsets can be compared.
        self._level_ns: int | None = 0 if stamps_of_host else None
        self._unconfirmed: dict[int, tuple[int, int]] = {}
        """Level and time of arrival of each unconfirmed sample, by its stamp."""

    def observe(self, ns: int, host_ns: int) -> None:
        """Update the estimate with a sample stamped ``ns`` that arrived at ``host_ns``."""
        if self._stamps_of_host:
            return
        level_ns = host_ns - ns - host_ns // _DRIFT_PER
        if self._level_ns is not None and level_ns >= self._level_ns:
            return
        self._unconfirmed = {
            stamp_ns: (level, at_ns)
            for stamp_ns, (level, at_ns) in self._unconfirmed.items()
            if host_ns - at_ns <= REMEMBERED_NS
        }
        self._unconfirmed.setdefault(ns, (level_ns, host_ns))  # the first was the fastest
        if len(self._unconfirmed) > MAX_UNCONFIRMED:
            del self._unconfirmed[next(iter(self._unconfirmed))]
        while self._confirm():
            pass

    def restart(self) -> None:
        """Drop the estimate: the source has set its clock back or was restarted."""
        if not self._stamps_of_host:
            self._level_ns = None
            self._unconfirmed.clear()

    def offset_ns(self, host_ns: int) -> int | None:
        """Host time minus source time at ``host_ns``; None while it is not known."""
        if self._level_ns is None or self._stamps_of_host:
            return self._level_ns
        return self._level_ns + host_ns // _DRIFT_PER

    def now(self, host_ns: int) -> Stamp | None:
        """The present on the source's clock; None while it is not known."""
        offset_ns = self.offset_ns(host_ns)
        return None if offset_ns is None else Stamp(host_ns - offset_ns)

    def host_time_for(self, ns: int) -> int:
        """Host time in ns after which the source's clock has advanced by at least ``ns``."""
        return ns if self._stamps_of_host else -(-ns * _DRIFT_PER // (_DRIFT_PER - 1)) + 1

    def _confirm(self) -> bool:
        """Lower the level to the lowest confirmed one; return True if it changed."""
        levels = sorted(level_ns for level_ns, _ in self._unconfirmed.values())
        confirmed = [
            level_ns
            for level_ns, last_ns in zip(levels, levels[CONFIRMED_BY - 1 :], strict=False)
            if last_ns - level_ns <= CONFIRMED_WITHIN_NS
        ]
        if self._level_ns is not None:
            lowest_ns = self._level_ns - CONFIRMED_WITHIN_NS
            confirmed += [level_ns for level_ns in levels if level_ns >= lowest_ns]
        if not confirmed:
            return False
        confirmed_ns = self._level_ns = min(confirmed)
        self._unconfirmed = {
            ns: each for ns, each in self._unconfirmed.items() if each[0] < confirmed_ns
        }
        return True


COMPLETE_WITHIN_NS = 5 * NS_PER_MS
"""Time for which a sample waits for the others with its acquisition stamp."""

JUMP_NS = 500 * NS_PER_MS
"""A sample older by this than the newest of its edge means that the source's clock was set back."""

MAX_EDGES = 256
"""Most edges of a source; further ones are rejected. No operating room has that many frames."""

MAX_GROUPS = 64
"""Most acquisition stamps whose samples wait at once; beyond it the oldest are dropped."""

REPORT_MISSING_AFTER_NS = 2 * NS_PER_S
"""Time after the first sample before missing frames are reported: tools come into view first."""

REPLACED = "samples that a newer one replaced"

SET_BACK = "times that the source's clock was set back"

MAX_NAME_CHARS = 256
"""Longest frame name in characters; with `MAX_EDGES` it bounds the memory used by senders."""


@dataclass(slots=True)
class _Group:
    """Samples with one acquisition stamp; ``since_ns`` is the host time of the first arrival."""

    since_ns: int
    samples: dict[Edge, TrackedTransform] = field(default_factory=dict)


class LiveFrames:
    """Collects the samples that connect the tumour to the tool and returns them as frames.

    Without ``edges``, the edges on the shortest paths between the session's frames are used, and
    those that measure a robot's base, which is an error that the session reports. With ``edges``,
    only these are used. Without them, samples of ``setup.shown_frames`` come with the others
    (`AuxiliarySamples`). A frame is ready when it holds all edges that came with the previous
    stamp, or when its first sample has waited for `COMPLETE_WITHIN_NS`. Frames that are ready
    together are merged into one with the newest sample of each edge, so that a session that is
    slower than its source stays in the present and no queue grows; a lost pose ends such a frame,
    so that none is hidden by a newer one. The first sample of the next stamp does not split a
    complete frame.

    Duplicates are dropped; two samples with one stamp that differ become INVALID. `left_out` counts
    the samples that were not used, by reason. Host times are integer ns, passed in.
    """

    def __init__(self, setup: SessionSetup, clock: SourceClock, edges: Sequence[Edge] = ()) -> None:
        self._take_setup(setup)
        self._began_ns: int | None = None
        self._named = frozenset(edges)
        self._clock = clock
        self._recent = RecentSamples()
        self._edges: dict[Edge, None] = {}
        self._used: frozenset[Edge] = frozenset()
        self._together: dict[Edge, frozenset[Edge]] = {}
        self._last_stamp_of: dict[Edge, int] = {}
        self._newest: dict[Edge, TrackedTransform] = {}
        self._groups: dict[int, _Group] = {}
        self._auxiliary = AuxiliarySamples(() if self._named else setup.shown_frames)
        self._joints = JointQueue(setup.margins.stale_after_ns)
        self._restarted = False
        self._first_ns: int | None = None
        self._missing_frames: str | None = None
        self.left_out: Counter[str] = Counter()

    def use(self, setup: SessionSetup) -> None:
        """Use the edges that another setup of the session needs, from the next sample on."""
        if setup is not self._setup:
            self._take_setup(setup)
            self._find_used()

    def _take_setup(self, setup: SessionSetup) -> None:
        self._setup, self._ends = setup, setup.measured_ends
        own = [(edge.target, edge.source) for edge in setup.static_edges]
        base = None if setup.robot is None else setup.robot.base_frame
        self._own_edges = frozenset(own)
        self._own_frames = frozenset(child for _, child in own if child != base)

    @property
    def edges(self) -> tuple[Edge, ...]:
        """Edges (parent, child) in use, in alphabetical order."""
        return tuple(sorted(self._used))

    def missing_frames_problem(self, host_ns: int) -> str:
        """Message on frames of the session that have not been received so far; empty if none.

        Empty also during the first `REPORT_MISSING_AFTER_NS`, of the calls and of the samples.
        """
        if self._began_ns is None:
            self._began_ns = host_ns
        if self._first_ns is None:
            is_early = host_ns - self._began_ns < REPORT_MISSING_AFTER_NS
            return "" if is_early else nothing_received_problem(self._setup)
        if host_ns - self._first_ns < REPORT_MISSING_AFTER_NS:
            return ""
        if self._missing_frames is None:
            self._missing_frames = missing_frames_problem(
                self._setup, tuple(self._edges), self._named
            )
        return self._missing_frames

    def add(self, samples: Sequence[TrackedTransform], host_ns: int, *, train: bool = True) -> None:
        """Add samples that arrived together at ``host_ns``.

        ``train`` False: they may have waited before, and do not train the clock.
        """
        for sample in samples:
            self._add(sample, host_ns, train)

    def add_joints(self, sample: JointSample) -> None:
        """Add joints, stamped by the source's clock.

        A frame carries the newest whose stamp it has reached (`JointQueue`).
        """
        if not self._joints.add(sample):
            self.left_out["joints that came late"] += 1

    def ready_in_ns(self, host_ns: int) -> int | None:
        """Time in ns until a frame is ready: 0 for now, None until another sample arrives.

        0 also after a restart of the source, so that the session steps without a frame at once.
        """
        if self._restarted:
            return 0
        if self._clock.now(host_ns) is None:
            return None
        due = [self._due_ns(group) for group in self._groups.values()]
        return max(0, min(due) - host_ns) if due else None

    def take(self, host_ns: int) -> TrackingFrame | None:
        """Remove all ready samples as one frame, stamped with the present; None without any."""
        self._restarted = False
        now = self._clock.now(host_ns)
        ready = [ns for ns, group in self._groups.items() if self._due_ns(group) <= host_ns]
        if not ready or now is None:
            return None
        poses: dict[Edge, TrackedTransform] = {}
        for ns in sorted(ready):
            samples = self._groups.pop(ns).samples
            for edge in samples:
                self._together[edge] = frozenset(samples)
                self._last_stamp_of[edge] = ns
            self.left_out[REPLACED] += len(poses.keys() & samples.keys())
            poses.update(samples)
            if any(sample.transform is None for sample in samples.values()):
                break  # a step of its own: newer samples would hide that a pose was lost
        return self._frame(now, tuple(poses.values()))

    def take_others(self, now: Stamp) -> TrackingFrame:
        """A frame at ``now`` without poses that a decision uses, with the newest joints."""
        return self._frame(now, ())

    def _frame(self, now: Stamp, poses: tuple[TrackedTransform, ...]) -> TrackingFrame:
        frame = TrackingFrame(now, (*poses, *self._auxiliary.take()), self._joints.take(now))
        # Only here: the clock is estimated, and duplicates are found, by the stamps as sent.
        return self._setup.tracking.acquired(frame)

    def _add(self, sample: TrackedTransform, host_ns: int, train: bool) -> None:
        edge = (sample.target, sample.source)
        if not self._is_used(edge, host_ns):
            self._auxiliary.add(sample, self._clock.now(host_ns))
            return
        known = self._newest.get(edge)
        if known is not None and sample.stamp < known.stamp and self._is_ahead(known, host_ns):
            known = None  # after a stamp from the future, samples of the present are not late
        is_duplicate = self._recent.is_duplicate(sample, host_ns)
        if (
            known is not None
            and sample.stamp.ns < known.stamp.ns - JUMP_NS
            and not is_duplicate  # old samples sent again, by a relay or on purpose: no clock jump
        ):
            self._restart()
            known = None
        if train:
            self._clock.observe(sample.stamp.ns, host_ns)
        if known is not None and sample.stamp.ns <= known.stamp.ns:
            if sample.stamp.ns < known.stamp.ns:
                self.left_out["samples that came late"] += 1
                return
            sample = agreed_sample(known, sample)
            if sample is known:
                self.left_out["samples that came twice"] += 1
                return
        self._newest[edge] = sample
        self._group_of(edge, sample.stamp.ns, host_ns).samples[edge] = sample

    def _is_ahead(self, sample: TrackedTransform, host_ns: int) -> bool:
        now = self._clock.now(host_ns)
        return now is not None and now < sample.stamp

    def _group_of(self, edge: Edge, ns: int, host_ns: int) -> _Group:
        late_to = [other for other, last_ns in self._last_stamp_of.items() if last_ns == ns]
        for other in late_to:  # late member of a group: expected from the next stamp on
            together = self._together[other] | {edge}
            for member in together:
                self._together[member] = together
        if ns not in self._groups and len(self._groups) >= MAX_GROUPS:
            dropped = self._groups.pop(min(self._groups))
            self.left_out[REPLACED] += len(dropped.samples)
        return self._groups.setdefault(ns, _Group(host_ns))

    def _due_ns(self, group: _Group) -> int:
        """Host time at which the group is ready: at once if all expected edges are there."""
        expected = [self._together.get(edge) for edge in group.samples]
        if all(edges is not None and edges <= group.samples.keys() for edges in expected):
            return group.since_ns
        return group.since_ns + COMPLETE_WITHIN_NS

    def _is_used(self, edge: Edge, host_ns: int) -> bool:
        if edge in self._used:
            return True
        if edge in self._edges:
            return False
        # Our own transforms return on /tf.
        if edge in self._own_edges or edge[1] in self._own_frames:
            return False
        if edge not in self._named:
            if max(map(len, edge)) > MAX_NAME_CHARS:
                self._refuse(f"frame names of more than {MAX_NAME_CHARS} letters")
                return False
            if len(self._edges) >= MAX_EDGES:
                self._refuse(f"edges beyond {MAX_EDGES}")
                return False
        self._edges[edge] = None
        self._find_used()
        if self._first_ns is None:
            self._first_ns = host_ns
        return edge in self._used

    def _find_used(self) -> None:
        self._used = self._named & self._edges.keys() if self._named else self._edges_in_use()
        self._auxiliary.find(self._edges, self._used, self._setup.frame_from_tumor.target)
        self._missing_frames = None

    def _refuse(self, why: str) -> None:
        """Count a rejected edge; with named ``edges`` all others are ignored without a count."""
        if not self._named:
            self.left_out[why] += 1

    def _edges_in_use(self) -> frozenset[Edge]:
        edges = tuple(self._edges)
        paths = [shortest_path(edges, *ends) or () for ends in self._ends]
        paths.append(path_to_base(self._setup, edges))
        return frozenset(edge for path in paths for edge in path)

    def _restart(self) -> None:
        self._restarted = True
        self.left_out[SET_BACK] += 1
        self._clock.restart()
        self._newest.clear()
        self._groups.clear()
        self._last_stamp_of.clear()
        self._joints.clear()
        self._auxiliary.restart()
