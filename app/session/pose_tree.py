"""Latest sample of every measured edge, and the pose between any two frames computed from them."""

from collections.abc import Iterable
from dataclasses import astuple, dataclass, field, replace
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np

from app.case import TrackingFrame
from app.fixture import Reason
from app.fixture.control.states import reasons_of
from app.geometry import (
    Edge,
    FreshnessLimits,
    Stamp,
    TrackedTransform,
    Transform,
    shortest_path,
)
from app.session.repetition import SOURCE_REPETITION, restart
from app.session.sensor_motion import (
    MotionLimits,
    State,
    begin_motion,
    jump_of,
    restart_motion,
)
from app.session.tracked_edges import (
    EDGE,
    LIMITS,
    PATH,
    SAMPLE,
    TAKEN,
    Steps,
    follow_paths,
    judge_edges,
    take_samples,
)

_NOTHING: frozenset[Reason] = frozenset()
_JUMPED = frozenset({Reason.CLOCK_JUMPED_BACK})
_NOTHING_FIXED = Transform.identity("frame", "frame")
_Path: TypeAlias = tuple[str, str, Transform, Transform]


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


@dataclass(frozen=True, slots=True)
class PoseRules:
    """The limits of the samples, and the frames that they concern.

    A pose that repeats the same values for longer than ``limits.frozen_after_ns`` is frozen, unless
    its sensor rests and has repeated as long before; the poses of a tracker whose sensors all
    repeat at once, and never did before, are frozen once they are as old as a stale one
    (`app.session.repetition`). An edge that has *never* changed, including before a jump of the
    clock, is treated as a fixed transform (recordings carry calibrations among the measured ones),
    except the edges that touch ``moving_frames``: each of these has a sensor. A sensor of
    ``shown_frames`` alone does not show that its tracker goes on: no decision depends on it.

    On the paths between the pairs of frames ``checked``, a pose that its sensor cannot have reached
    by ``motion`` is not used (`app.session.sensor_motion`).
    """

    limits: FreshnessLimits
    moving_frames: tuple[str, ...]
    shown_frames: tuple[str, ...] = ()
    motion: MotionLimits = field(default_factory=MotionLimits)
    checked: tuple[Edge, ...] = ()


class PoseTree:
    """Holds the latest sample of each edge; drops all samples when the source's clock jumps back.

    The latest sample is the one acquired last: a sample that arrives after a newer one is ignored,
    even if the newer one was not plausible.

    A path that was asked for once is followed in every frame until the rules are replaced.
    """

    def __init__(self, rules: PoseRules) -> None:
        self._now: Stamp | None = None
        self._rows: dict[Edge, int] = {}
        """Number of each edge that was ever sent."""
        self._edges: dict[Edge, int] = {}
        """Those with a sample since the last jump of the clock, in the order of the first one."""
        self.edges: tuple[Edge, ...] = ()
        """The same without the numbers; replaced when an edge comes."""
        self._latest: list[TrackedTransform | None] = []
        self._trackers: dict[str, int] = {}
        self._state: State = np.zeros(0, EDGE)
        self._sources: State = np.zeros(0, SOURCE_REPETITION)
        self._limits: State = np.zeros(1, LIMITS)
        self._rules = rules
        self._make_room(4)
        self._samples: State = np.zeros(0, SAMPLE)
        self._followed: State = np.zeros(0, PATH)
        self._steps: Steps = np.zeros((0, 2), np.int64)
        self._paths: dict[_Path, tuple[int, str, str]] = {}
        """Number of each path that was asked for, and the frames of its pose."""
        self._found: list[list[int]] | None = None
        """Numbers of each path at the present, once they are read."""
        self.use(rules)
        # Run the kernels once, so that the first step does not wait for the compiler.
        self.insert(TrackingFrame(Stamp(0), ()))
        self._now = None

    def use(self, rules: PoseRules) -> None:
        """Replace the rules between two frames; what is known of the sensors is kept."""
        self._rules, self._are_checked = rules, False
        self._limits[0] = rules.limits.numbers_ns
        self._state["motion"]["limits"] = astuple(rules.motion)
        for edge in self._rows:
            self._mark(edge)
        self._paths.clear()
        now_ns = 0 if self._now is None else self._now.ns  # no edges are known then
        judge_edges(self._state, self._sources, self._limits, now_ns)
        self._follow()

    @property
    def limits(self) -> FreshnessLimits:
        """Those of the samples' age."""
        return self._rules.limits

    def insert(self, frame: TrackingFrame) -> frozenset[Reason]:
        """Store the samples of ``frame`` and make its stamp the present.

        Returns `Reason.CLOCK_JUMPED_BACK` when the present went back; all earlier samples are
        then dropped. Raises `StampError` for stamps of another clock; nothing is then changed.
        """
        now = frame.stamp
        jumped = self._now is not None and now < self._now
        rows = self._write(frame)
        if not self._are_checked:
            self._check_paths()
        if jumped:
            self._restart()
        self._now, self._found = now, None
        self.accepted = frame
        """The last frame without the samples that are late or not plausible."""
        others = take_samples(
            self._samples,
            len(rows),
            now.ns,
            self._limits,
            self._state,
            self._sources,
            self._followed,
            self._steps,
        )
        outcomes = self._outcomes[: len(rows)].tolist() if others else None
        for k, sample in enumerate(frame.poses):
            if outcomes is None or outcomes[k] == TAKEN:
                self._latest[rows[k]] = sample
        if outcomes is not None:
            self._note_others(frame, outcomes)
        return _JUMPED if jumped else _NOTHING

    def _write(self, frame: TrackingFrame) -> list[int]:
        """Write the samples of ``frame`` to the array of them; return the number of each edge."""
        now, rows = frame.stamp, []
        if len(frame.poses) >= len(self._samples):
            samples = self._samples = np.zeros(2 * len(frame.poses) + 1, SAMPLE)
            self._edge_of, self._ns_of = samples["edge"], samples["ns"]
            self._status_of, self._outcomes = samples["status"], samples["outcome"]
            self._rotation_of, self._position_of = samples["rotation"], samples["position"]
        for k, sample in enumerate(frame.poses):
            edge, stamp, pose = (sample.target, sample.source), sample.stamp, sample.transform
            row = self._rows.get(edge)
            if row is None:
                row = self._add_edge(edge)
            if stamp.clock != now.clock:
                stamp.age_ns(now)  # raises
            rows.append(row)
            self._edge_of[k], self._ns_of[k], self._status_of[k] = row, stamp.ns, sample.status
            if pose is not None:
                self._rotation_of[k], self._position_of[k] = pose.rotation, pose.translation_mm
        return rows

    def _note_others(self, frame: TrackingFrame, outcomes: list[int]) -> None:
        """Note the edges that are new, and the samples that were not taken."""
        known, each = len(self._edges), zip(frame.poses, outcomes, strict=True)
        taken = tuple(sample for sample, outcome in each if outcome == TAKEN)
        for sample in taken:
            edge = sample.target, sample.source
            self._edges.setdefault(edge, self._rows[edge])
        if len(taken) < len(frame.poses):
            self.accepted = replace(frame, poses=taken)
        if len(self._edges) > known:
            self._know_edges()

    def pose(
        self,
        target: str,
        source: str,
        outer: Transform = _NOTHING_FIXED,
        inner: Transform = _NOTHING_FIXED,
    ) -> MeasuredPose:
        """``target_from_source`` along the shortest path over measured edges.

        The fixed poses ``outer`` and ``inner`` are multiplied from the left and from the right.
        Raises `FrameError` if they are of other frames.
        """
        path = target, source, outer, inner
        if path not in self._paths:
            self._add_path(path)
        number, new_target, new_source = self._paths[path]
        if self._found is None:
            self._found = self._verdicts.tolist()
            self._rotations = self._followed["rotation"].copy()
            self._positions = self._followed["position"].copy()
            for array in (self._rotations, self._positions):
                array.setflags(False)  # type: ignore[call-arg]  # quicker than by name
        count, row, unchanged_ns, problems = self._found[number]
        if count < 0 or self._now is None:
            return _UNKNOWN
        sample, transform = None if row < 0 else self._latest[row], None
        if not problems:
            rotation, position = self._rotations[number], self._positions[number]
            transform = Transform.of_read_only(new_target, new_source, rotation, position)
        stamp = None if sample is None else sample.stamp
        return MeasuredPose(transform, stamp, unchanged_ns, _reasons(problems))

    def _add_path(self, path: _Path) -> None:
        target, source, outer, inner = path
        if outer is not _NOTHING_FIXED:
            target = (outer @ Transform.identity(target, source)).target
        if inner is not _NOTHING_FIXED:
            source = (Transform.identity(target, source) @ inner).source
        number = len(self._paths)
        self._paths[path] = number, target, source
        self._follow(number)

    def usable(self) -> dict[Edge, TrackedTransform | None]:
        """Latest sample of each edge; None for one that may not be used now."""
        problems, latest = self._problems.tolist(), self._latest
        return {edge: None if problems[row] else latest[row] for edge, row in self._edges.items()}

    def implausible(self) -> dict[str, str]:
        """The sensors on the checked paths that are not believed now: one line each, by name."""
        found: dict[str, str] = {}
        if True in self._refused.tolist():
            for edge, row in self._rows.items():
                state = self._state[row]
                jump = jump_of(state["motion"]) if state["is_checked"] else None
                if jump is not None:
                    name = f"{edge[0]} -> {edge[1]}"
                    found[name] = f"{name} {jump.text}"
        return found

    def never_changed(self) -> tuple[Edge, ...]:
        """Edges (target, source) that are treated as fixed transforms so far."""
        moving = self._state["has_changed"] | self._state["has_sensor"]
        return tuple(edge for edge, row in self._edges.items() if not moving[row])

    def known_frames(self) -> tuple[str, ...]:
        """Names of all frames of measured edges, in alphabetical order."""
        return tuple(sorted({name for edge in self._edges for name in edge}))

    def _add_edge(self, edge: Edge) -> int:
        row = self._rows[edge] = len(self._rows)
        self._latest.append(None)
        self._trackers.setdefault(edge[0], len(self._trackers))
        if row == len(self._state):
            self._make_room(2 * row)
        self._mark(edge)
        return row

    def _make_room(self, count: int) -> None:
        """Make room for ``count`` edges, each of another tracker; keep what is known."""
        before, sources = self._state, self._sources
        self._state, self._sources = np.zeros(count, EDGE), np.zeros(count, SOURCE_REPETITION)
        begin_motion(self._state["motion"], self._rules.motion)
        self._state[: len(before)], self._sources[: len(sources)] = before, sources
        self._problems, self._refused = self._state["problems"], self._state["motion"]["refused"]

    def _mark(self, edge: Edge) -> None:
        target, source = edge
        state, moving = self._state[self._rows[edge]], self._rules.moving_frames
        state["source"] = self._trackers[target]
        state["has_sensor"] = target in moving or source in moving
        state["is_shown_only"] = source in self._rules.shown_frames and source not in moving

    def _check_paths(self) -> None:
        """Mark the edges on the checked paths over those that are known so far."""
        self._are_checked = True
        paths = [shortest_path(self._edges, *ends) or () for ends in self._rules.checked]
        self._state["is_checked"] = False
        for row in {self._edges[edge] for path in paths for edge in path}:
            self._state[row]["is_checked"] = True

    def _restart(self) -> None:
        """Drop all samples: the clock went back. What was learned of the sensors is kept."""
        self._edges.clear()
        for name in ("is_known", "is_good", "is_seen"):
            self._state[name] = False
        restart(self._state["repetition"], self._sources)
        restart_motion(self._state["motion"])
        self._know_edges()

    def _know_edges(self) -> None:
        self.edges, self._are_checked = tuple(self._edges), False
        self._follow()

    def _follow(self, first: int = 0) -> None:
        """Find the paths from the ``first`` on anew, over the edges known now, and follow them."""
        paths = list(self._paths)[first:]
        followed: State = np.zeros(len(paths), PATH)
        steps = self._steps.tolist() if first else []
        for path, (target, source, *fixed) in zip(followed, paths, strict=True):
            edges = shortest_path(self._edges, target, source)
            path["first"], path["count"] = len(steps), -1 if edges is None else len(edges)
            for name, pose in zip(("outer", "inner"), fixed, strict=True):
                path[f"{name}_rotation"] = pose.rotation
                path[f"{name}_position"] = pose.translation_mm
            for edge in edges or ():
                steps.append((self._edges[edge], int(edge[0] != target)))
                target = edge[1] if edge[0] == target else edge[0]
        self._steps = np.array(steps, np.int64).reshape(-1, 2)
        follow_paths(followed, self._steps, self._state)
        self._followed = np.concatenate([self._followed[:first], followed])
        numbers = self._followed.view(np.int64).reshape(-1, PATH.itemsize // 8)
        self._verdicts = numbers[:, 1:5]  # count to problems: all fields have 8 bytes
        self._found = None


@cache
def _reasons(problems: int) -> frozenset[Reason]:
    return frozenset(reasons_of(problems))


def oldest(poses: Iterable[MeasuredPose]) -> Stamp | None:
    """The earliest acquisition stamp of the samples of all ``poses``; None without a sample."""
    return min([pose.oldest for pose in poses if pose.oldest is not None], default=None)


def is_sampled(name: str, frame: TrackingFrame) -> bool:
    """True if ``frame`` holds a sample, good or lost, of an edge to or from ``name``."""
    return any(name in (sample.target, sample.source) for sample in frame.poses)
