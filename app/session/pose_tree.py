"""Latest sample of every measured edge, and the pose between any two frames computed from them."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from app.case import TrackingFrame
from app.fixture import REASON_OF_FRESHNESS, Reason, TumorMotionFilter, TumorMotionParameters
from app.geometry import (
    Edge,
    FloatArray,
    Freshness,
    FreshnessLimits,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    freshness_of,
    freshness_of_stamp,
    product_along,
    shortest_path,
)
from app.session.repetition import SensorRepetition, SourceRepetition

MAX_TRANSLATION_MM = 10_000.0
"""No tracker of an operating room measures beyond 10 m. Drivers send larger numbers for a missing
pose (NDI: -3.7e28), whatever the status is."""

REASON_OF_STATUS = {
    TrackingStatus.INVALID: Reason.INVALID,
    TrackingStatus.MISSING: Reason.MISSING,
    TrackingStatus.OUT_OF_VIEW: Reason.MISSING,
    TrackingStatus.OUT_OF_VOLUME: Reason.MISSING,
    TrackingStatus.REQUEST_TIMEOUT: Reason.MISSING,
    TrackingStatus.NOT_FINITE: Reason.NOT_FINITE,
    TrackingStatus.NOT_RIGID: Reason.NOT_RIGID,
}


_NOTHING: frozenset[Reason] = frozenset()
_TOO_FAR = frozenset({Reason.INVALID})
_FROZEN = frozenset({Reason.FROZEN})
_JUMPED = frozenset({Reason.CLOCK_JUMPED_BACK})


class MeasuredPose(NamedTuple):
    """``transform`` from the latest samples along the path, or the reasons why there is none.

    ``oldest`` is the earliest acquisition stamp of those samples, None when there are none.
    ``unchanged_ns`` is the longest time since a change of one of them, among those whose repetition
    is improbable in their own history (`app.session.repetition`); 0 if there are none.
    """

    transform: Transform | None
    oldest: Stamp | None
    unchanged_ns: int
    problems: frozenset[Reason]


_UNKNOWN = MeasuredPose(None, None, 0, frozenset({Reason.MISSING}))


@dataclass(slots=True)
class _EdgeState:
    latest: TrackedTransform
    latest_at: Stamp
    """The latest sample's stamp, or its time of arrival if that was earlier."""
    repetition: SensorRepetition
    latest_good: Transform | None = None
    latest_mm: list[float] = field(default_factory=list)
    """Its position."""
    unchanged_since_ns: int = 0
    bad: frozenset[Reason] = _NOTHING
    """Problems of the latest sample that do not depend on its age."""

    def update(self, sample: TrackedTransform, now: Stamp, limits: FreshnessLimits) -> bool:
        """Make ``sample`` the latest; return True if the pose has changed.

        Lost samples in between do not end a frozen run. A stamp from the future counts as
        ``now``, because no sample can have been acquired later.
        """
        self.latest = sample
        self.latest_at = sample.stamp if sample.stamp.ns <= now.ns else now
        pose, at_ns = sample.transform, self.latest_at.ns
        if pose is None:
            self.bad = frozenset({REASON_OF_STATUS[sample.status]})
            return False
        position_mm = pose.translation_mm.tolist()
        if is_too_far(position_mm):
            self.bad = _TOO_FAR
            return False
        self.bad = _NOTHING
        known, known_mm = self.latest_good, self.latest_mm
        self.latest_good, self.latest_mm = pose, position_mm
        if known is None:
            self.unchanged_since_ns = at_ns
            self.repetition.begin(pose, position_mm, at_ns)
            return False
        # Positions differ in nearly all cases, and lists of floats compare fastest.
        if known_mm == position_mm and known.rotation.tolist() == pose.rotation.tolist():
            self.repetition.repeat(at_ns - self.unchanged_since_ns)
            return False
        self.unchanged_since_ns = at_ns
        self.repetition.change(pose, position_mm, at_ns, limits)
        return True


@dataclass(slots=True)
class PoseTree:
    """Holds the latest sample of each edge; drops all samples when the source's clock jumps back.

    The latest sample is the one acquired last: a sample that arrives after a newer one is ignored.

    A pose that repeats the same values for longer than ``limits.frozen_after_ns`` is frozen, unless
    its sensor rests and has repeated as long before; the poses of a tracker whose sensors all
    repeat at once, and never did before, are frozen once they are as old as a stale one
    (`app.session.repetition`). An edge that has *never* changed, including before a jump of the
    clock, is treated as a fixed transform (recordings carry calibrations among the measured ones),
    except the edges that touch ``moving_frames``: each of these has a sensor. A sensor of
    ``shown_frames`` alone does not show that its tracker goes on: no decision depends on it.
    """

    limits: FreshnessLimits
    moving_frames: tuple[str, ...]
    shown_frames: tuple[str, ...] = ()
    _edges: dict[Edge, _EdgeState] = field(default_factory=dict)
    _changed: set[Edge] = field(default_factory=set)
    _sensors: dict[Edge, SensorRepetition] = field(default_factory=dict)
    _sources: dict[str, SourceRepetition] = field(default_factory=dict)
    """By the frame in which a tracker measures its sensors."""
    _paths: dict[Edge, tuple[Edge, ...] | None] = field(default_factory=dict)
    _now: Stamp | None = None
    _problems: dict[Edge, tuple[int, frozenset[Reason]]] = field(default_factory=dict)
    """Results of `_verdict` at the present, valid while `_judged_by` is unchanged."""
    _judged_by: tuple[object, object] = (None, None)

    def insert(self, frame: TrackingFrame) -> frozenset[Reason]:
        """Store the samples of ``frame`` and make its stamp the present.

        Returns `Reason.CLOCK_JUMPED_BACK` when the present went back; all earlier samples are
        then dropped.
        """
        jumped = self._now is not None and frame.stamp < self._now
        if jumped:
            self._edges.clear()
            self._paths.clear()
            for sensor in self._sensors.values():
                sensor.restart()
            for source in self._sources.values():
                source.restart()
        self._now = frame.stamp
        self._problems.clear()
        durations_ns: dict[str, list[int]] = {}
        for sample in frame.poses:
            edge = (sample.target, sample.source)
            state = self._insert_sample(edge, sample, frame.stamp)
            if state is None or state.bad or self._is_shown_only(sample.source):
                continue
            if self._has_to_move(edge):
                durations_ns.setdefault(sample.target, []).append(state.repetition.duration_ns)
        for tracker, each_ns in durations_ns.items():
            source = self._sources.setdefault(tracker, SourceRepetition())
            source.observe(each_ns, self.limits.stale_after_ns)
        return _JUMPED if jumped else _NOTHING

    def pose(self, target: str, source: str) -> MeasuredPose:
        """``target_from_source`` along the shortest path over measured edges."""
        path = self._path(target, source)
        if path is None or self._now is None:
            return _UNKNOWN
        oldest: Stamp | None = None
        unchanged_ns = 0
        problems = _NOTHING
        poses = []
        for edge in path:
            state = self._edges[edge]
            stamp = state.latest.stamp
            if state.latest.transform is not None:
                poses.append(state.latest.transform)
            if oldest is None or stamp.ns < oldest.ns:
                oldest = stamp
            edge_unchanged_ns, edge_problems = self._verdict(edge, state)
            if edge_unchanged_ns > unchanged_ns:
                unchanged_ns = edge_unchanged_ns
            if edge_problems:
                problems |= edge_problems
        transform = None if problems else product_along(target, poses)
        return MeasuredPose(transform, oldest, unchanged_ns, problems)

    def usable(self) -> dict[Edge, TrackedTransform | None]:
        """Latest sample of each edge; None for one that may not be used now."""
        return {
            edge: None if self._verdict(edge, state)[1] else state.latest
            for edge, state in self._edges.items()
        }

    def never_changed(self) -> tuple[Edge, ...]:
        """Edges (target, source) that are treated as fixed transforms so far."""
        return tuple(edge for edge in self._edges if not self._has_to_move(edge))

    @property
    def edges(self) -> tuple[Edge, ...]:
        """All measured edges, in the order of their first sample."""
        return tuple(self._edges)

    def known_frames(self) -> tuple[str, ...]:
        """Names of all frames of measured edges, in alphabetical order."""
        return tuple(sorted({name for edge in self._edges for name in edge}))

    def _insert_sample(self, edge: Edge, sample: TrackedTransform, now: Stamp) -> _EdgeState | None:
        """The state of the edge after ``sample``; None if a newer one is known."""
        stamp = sample.stamp
        stamp.age_ns(now)  # raises for another clock; below, only numbers are compared
        state = self._edges.get(edge)
        if state is None:
            sensor = self._sensors.setdefault(edge, SensorRepetition())
            state = self._edges[edge] = _EdgeState(sample, now, sensor)
            self._paths.clear()
        elif stamp.ns < state.latest.stamp.ns <= now.ns:
            return None
        if state.update(sample, now, self.limits):
            self._changed.add(edge)
        return state

    def _verdict(self, edge: Edge, state: _EdgeState) -> tuple[int, frozenset[Reason]]:
        """Time without a change, as in `MeasuredPose`, and problems of ``edge``, once per frame.

        Limits and moving frames may be replaced between two frames.
        """
        limits, moving = self._judged_by
        if limits is not self.limits or moving is not self.moving_frames:
            self._problems.clear()
            self._judged_by = (self.limits, self.moving_frames)
        found = self._problems.get(edge)
        if found is None:
            sensor, source, unchanged_ns = state.repetition, self._sources.get(edge[0]), 0
            if sensor.repeats and self._has_to_move(edge):
                unchanged_ns = sensor.unchanged_ns(self.limits, source)
            problems = state.bad or self._age_problems(state.latest.stamp, unchanged_ns)
            if sensor.repeats and source and source.is_stuck(self.limits.stale_after_ns):
                problems |= _FROZEN
            found = self._problems[edge] = unchanged_ns, problems
        return found

    def _has_to_move(self, edge: Edge) -> bool:
        target, source = edge
        frames = self.moving_frames
        return edge in self._changed or target in frames or source in frames

    def _is_shown_only(self, frame: str) -> bool:
        return frame in self.shown_frames and frame not in self.moving_frames

    def _age_problems(self, stamp: Stamp, unchanged_ns: int) -> frozenset[Reason]:
        assert self._now is not None, "edges are known"
        freshness = freshness_of(stamp.ns, self._now.ns, self.limits, unchanged_ns)
        if freshness is Freshness.VALID:
            return _NOTHING
        problems = frozenset({REASON_OF_FRESHNESS[freshness]})
        # A frozen sensor whose samples also come late is reported with both reasons.
        return problems | _FROZEN if self.limits.is_frozen(unchanged_ns) else problems

    def _path(self, target: str, source: str) -> tuple[Edge, ...] | None:
        ends = (target, source)
        if ends not in self._paths:
            self._paths[ends] = shortest_path(self._edges, target, source)
        return self._paths[ends]


def oldest(poses: Iterable[MeasuredPose]) -> Stamp | None:
    """The earliest acquisition stamp of the samples of all ``poses``; None without a sample."""
    return min([pose.oldest for pose in poses if pose.oldest is not None], default=None)


def is_too_far(position_mm: list[float]) -> bool:
    """True for a position (3,) beyond `MAX_TRANSLATION_MM`, which no tracker has measured."""
    x, y, z = position_mm
    limit = MAX_TRANSLATION_MM
    return not (-limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit)


def is_sampled(name: str, frame: TrackingFrame) -> bool:
    """True if ``frame`` holds a sample, good or lost, of an edge to or from ``name``."""
    return any(name in (sample.target, sample.source) for sample in frame.poses)


class TumorVelocity:
    """Feeds the tumour's poses to a `TumorMotionFilter`, step by step.

    ``frame_from_tumor`` is the tumour in the tracked frame that it moves with.
    """

    def __init__(self, parameters: TumorMotionParameters, frame_from_tumor: Transform) -> None:
        self._parameters = parameters
        self._frame_from_tumor = frame_from_tumor
        self._filter = TumorMotionFilter(parameters)
        self._now: Stamp | None = None
        self._newest: Stamp | None = None

    def twist(
        self, reference_from_frame: MeasuredPose, now: Stamp, limits: FreshnessLimits
    ) -> FloatArray | None:
        """Twist (6,) of the tumour at ``now`` in mm/s and rad/s, along its own axes.

        None if no sample that the filter accepted is fresh; the tumour then counts as still. The
        filter is reset when ``now`` goes back.
        """
        if self._now is not None and now < self._now:
            self._filter, self._newest = TumorMotionFilter(self._parameters), None
        self._now = now
        pose, stamp = reference_from_frame.transform, reference_from_frame.oldest
        # `MeasuredPose.transform` is None for a stale, lost or future pose.
        if (
            pose is not None
            and stamp is not None
            and (self._newest is None or self._newest < stamp)
        ):
            self._newest = stamp
            self._filter.update(pose @ self._frame_from_tumor, stamp)
        motion = self._filter.at(now)
        if motion is None or freshness_of_stamp(motion.stamp, now, limits) is not Freshness.VALID:
            return None
        return motion.twist
