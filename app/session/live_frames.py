"""Samples as they arrive from a live source become the frames that a session steps through."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from app.case import JointSample, TrackingFrame, agreed_sample
from app.geometry import NS_PER_MS, NS_PER_S, TrackedTransform
from app.session.live_clock import SourceClock
from app.session.named_frames import not_sent, way_to_base
from app.session.pose_tree import Edge, shortest_path
from app.session.recent_samples import RecentSamples
from app.session.setup import REFERENCE, SessionSetup

COMPLETE_WITHIN_NS = 5 * NS_PER_MS
"""How long a sample waits for the others of its acquisition stamp."""

JUMP_NS = 500 * NS_PER_MS
"""A sample this much older than the newest of its edge: the source's clock was set back."""

MOST_EDGES = 256
"""More than these are no tree of frames of an operating room: what comes further is refused."""


MOST_GROUPS = 64
"""Acquisition stamps whose samples may wait at once; then the oldest ones go."""

PATIENCE_NS = 2 * NS_PER_S
"""So long after the first sample a frame that has not come is told: tools are put in view first."""

REPLACED = "samples that a newer one replaced"

SET_BACK = "times that the source's clock was set back"

LONGEST_NAME = 256
"""Letters of a frame's name; with `MOST_EDGES` it bounds what strangers can have us keep."""


@dataclass(slots=True)
class _Group:
    """The samples of one acquisition stamp, and since when (host time) the first is here."""

    since_ns: int
    samples: dict[Edge, TrackedTransform] = field(default_factory=dict)


class LiveFrames:
    """Gathers the samples that lead from the tumour to the tool, and gives them out as frames.

    Every edge that is seen is looked at once: those on the shortest ways between the session's
    frames are used, and those by which a robot's base is measured, where it should not be; or
    those of ``edges`` where they are named. A frame is ready when it holds all that came together
    at the stamp before, or when its first sample has waited for `COMPLETE_WITHIN_NS`. Frames that
    are ready together are taken as one, with the newest sample of each edge, so that a session that
    is slower than its source stays in the present and nothing piles up. A frame that is complete is
    not torn by the first sample of the next.

    Of one sample that comes twice one is kept; two that contradict each other are INVALID. What
    was left out is in `left_out`, by reason. Host times are integer ns of the host's clock, handed
    in.
    """

    def __init__(self, setup: SessionSetup, clock: SourceClock, edges: Sequence[Edge] = ()) -> None:
        self._setup = setup
        tool, tumor = setup.tool_from_tip.target, setup.frame_from_tumor.target
        self._ways = [(tumor, tool), *([(REFERENCE, tool)] if setup.robot is not None else [])]
        own = [(edge.target, edge.source) for edge in setup.static_edges]
        base = None if setup.robot is None else setup.robot.base_frame
        self._own_edges = frozenset(own)
        self._own_frames = frozenset(child for _, child in own if child != base)
        self._named = frozenset(edges)
        self._clock = clock
        self._recent = RecentSamples()
        self._edges: dict[Edge, None] = {}
        self._used: frozenset[Edge] = frozenset()
        self._together: dict[Edge, frozenset[Edge]] = {}
        self._last_stamp_of: dict[Edge, int] = {}
        self._newest: dict[Edge, TrackedTransform] = {}
        self._groups: dict[int, _Group] = {}
        self._joints: JointSample | None = None
        self._anew = False
        self._first_ns: int | None = None
        self._lacks: str | None = None
        self.left_out: Counter[str] = Counter()

    @property
    def edges(self) -> tuple[Edge, ...]:
        """The edges (parent, child) that are used, in alphabetical order."""
        return tuple(sorted(self._used))

    def not_sent(self, host_ns: int) -> str:
        """Which frames of the session never came in the first `PATIENCE_NS` and since, in words.

        Empty before that, and where the source says nothing at all.
        """
        if self._first_ns is None or host_ns - self._first_ns < PATIENCE_NS:
            return ""
        if self._lacks is None:
            self._lacks = not_sent(self._setup, tuple(self._edges), self._named)
        return self._lacks

    def add(self, samples: Sequence[TrackedTransform], host_ns: int) -> None:
        """Take samples that arrived together at ``host_ns``."""
        for sample in samples:
            self._add(sample, host_ns)

    def add_joints(self, sample: JointSample) -> None:
        """Take the joints, on the source's clock; the newest go with the next frame."""
        if self._joints is None or self._joints.stamp <= sample.stamp:
            self._joints = sample
        else:
            self.left_out["joints that came late"] += 1

    def ready_in_ns(self, host_ns: int) -> int | None:
        """How long until there is a frame to take: 0 is now, None is not before a sample comes.

        A source that starts anew is told at once, by a frame that is not there.
        """
        if self._anew:
            return 0
        if self._clock.now(host_ns) is None:
            return None
        due = [self._due_ns(group) for group in self._groups.values()]
        return max(0, min(due) - host_ns) if due else None

    def take(self, host_ns: int) -> TrackingFrame | None:
        """All that is ready as one frame, stamped with the present; None when nothing is."""
        self._anew = False
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
        joints = () if self._joints is None else (self._joints,)
        self._joints = None
        return TrackingFrame(now, tuple(poses.values()), joints)

    def _add(self, sample: TrackedTransform, host_ns: int) -> None:
        edge = (sample.target, sample.source)
        if not self._is_used(edge, host_ns):
            return
        known = self._newest.get(edge)
        if known is not None and sample.stamp < known.stamp and self._is_ahead(known, host_ns):
            known = None  # a stamp from the future does not make those of the present late
        is_repeated = self._recent.was_there(sample, host_ns)
        if (
            known is not None
            and sample.stamp.ns < known.stamp.ns - JUMP_NS
            and not is_repeated  # by a relay, or by somebody who would have the old pass for new
        ):
            self._start_anew()
            known = None
        self._clock.arrived(sample.stamp.ns, host_ns)
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
        for other in late_to:  # it was not waited for, and will be from the next stamp on
            together = self._together[other] | {edge}
            for member in together:
                self._together[member] = together
        if ns not in self._groups and len(self._groups) >= MOST_GROUPS:
            dropped = self._groups.pop(min(self._groups))
            self.left_out[REPLACED] += len(dropped.samples)
        return self._groups.setdefault(ns, _Group(host_ns))

    def _due_ns(self, group: _Group) -> int:
        """When the group is to be given out: at once when nothing more is expected of its stamp."""
        expected = [self._together.get(edge) for edge in group.samples]
        if all(edges is not None and edges <= group.samples.keys() for edges in expected):
            return group.since_ns
        return group.since_ns + COMPLETE_WITHIN_NS

    def _is_used(self, edge: Edge, host_ns: int) -> bool:
        if edge in self._used:
            return True
        if edge in self._edges:
            return False
        # What we publish ourselves comes back to us on /tf.
        if edge in self._own_edges or edge[1] in self._own_frames:
            return False
        if edge not in self._named:
            if max(map(len, edge)) > LONGEST_NAME:
                self._refuse(f"frame names of more than {LONGEST_NAME} letters")
                return False
            if len(self._edges) >= MOST_EDGES:
                self._refuse(f"edges beyond {MOST_EDGES}")
                return False
        self._edges[edge] = None
        self._used = self._named & self._edges.keys() if self._named else self._found()
        self._lacks = None
        if self._first_ns is None:
            self._first_ns = host_ns
        return edge in self._used

    def _refuse(self, why: str) -> None:
        """Count an edge that might have been used: with ``edges`` named, all others are ignored."""
        if not self._named:
            self.left_out[why] += 1

    def _found(self) -> frozenset[Edge]:
        edges = tuple(self._edges)
        ways = [shortest_path(edges, *way) or () for way in self._ways]
        return frozenset(edge for way in [*ways, way_to_base(self._setup, edges)] for edge in way)

    def _start_anew(self) -> None:
        self._anew = True
        self.left_out[SET_BACK] += 1
        self._clock.restart()
        self._newest.clear()
        self._groups.clear()
        self._last_stamp_of.clear()
        self._joints = None
