"""Recordings, and freezes that are injected into them.

A freeze repeats the last pose of one sensor, or of all, with stamps that go on. Times are those
from the last true sample until the margin grows, and until the pose is frozen.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.case import TrackingFrame, read_recording
from app.fixture import Reason
from app.geometry import NS_PER_MS, NS_PER_S, FreshnessLimits, Stamp, TrackedTransform, Transform
from app.session.pose_tree import PoseRules, PoseTree

LIMITS = FreshnessLimits(200 * NS_PER_MS, frozen_after_ns=1000 * NS_PER_MS)
V_MAX_MM_S = 50.0
MOVING_MM_S, RESTING_MM_S = 30.0, 3.0
WARM_UP = 0.3
"""Share of a recording before the first freeze."""
HELD_NS = 6 * NS_PER_S


@dataclass(frozen=True)
class Recorded:
    """Frames with the sensors ``tool`` and ``reference`` of one tracker."""

    frames: tuple[TrackingFrame, ...]
    reference: str
    tool: str

    def tree(self) -> PoseTree:
        """A tree without a history."""
        return PoseTree(PoseRules(LIMITS, (self.tool, self.reference)))

    @property
    def sensors(self) -> tuple[str, ...]:
        """All sensors of the tracker."""
        return tuple({each.source for frame in self.frames for each in frame.poses})


@dataclass(frozen=True)
class Detection:
    """Times in ms from the last true sample; None if it was not detected within `HELD_NS`."""

    grows_ms: float | None
    frozen_ms: float | None


def quantised(seed: int = 1, seconds: float = 90.0) -> Recorded:
    """A tracker with steps of 0.1116 mm at 11.4 Hz, a resting reference and a hand-held tool.

    The step, 36 inches / 2^13, and the rate are those of a public PLUS recording, in which a
    resting reference repeats in 61 % of its samples. The tool moves for 4 s and rests for 4 s.
    """
    random = np.random.default_rng(seed)
    step_mm, period_ns = 914.4 / 2**13, round(NS_PER_S / 11.4)
    frames, way_mm = [], 0.0
    for index in range(round(seconds * 11.4)):
        stamp = Stamp(index * period_ns)
        phase_s = (index * period_ns / NS_PER_S) % 8.0
        if phase_s < 4.0:
            way_mm += 60.0 * np.sin(np.pi * phase_s / 4.0) ** 2 * period_ns / NS_PER_S
        noise_mm = random.normal(0.0, 0.03, (2, 3))
        offsets_mm = np.array([[0.03, 0.01, -0.02], [0.0, 0.02, 0.01]]) + noise_mm
        at_rest = np.array([101.0, -23.0, 88.0])
        hand = [200.0 + 40.0 * np.sin(way_mm / 40.0), -30.0 + 40.0 * np.cos(way_mm / 40.0), 8.0]
        poses = [
            TrackedTransform.valid(
                Transform("tracker", source, np.eye(3), step_mm * np.round(mm / step_mm)), stamp
            )
            for source, mm in (
                ("reference", at_rest + offsets_mm[0]),
                ("stylus", hand + offsets_mm[1]),
            )
        ]
        frames.append(TrackingFrame(stamp, tuple(poses)))
    return Recorded(tuple(frames), "reference", "stylus")


def recorded(path: Path) -> Recorded:
    """Read a recording; the reference and another sensor of the same tracker are used."""
    frames = tuple(read_recording(path, lambda note: None))
    edges = {(each.target, each.source) for frame in frames for each in frame.poses}
    references = [edge for edge in edges if edge[1] == "reference"]
    tools = sorted(edge for edge in edges for known in references if edge[0] == known[0] != edge[1])
    tools = [edge for edge in tools if edge[1] != "reference"]
    # The tool that travels the longest way.
    tool = max(tools, key=lambda edge: _way_mm(frames, edge[1]))
    return Recorded(frames, "reference", tool[1])


def clean_run(recording: Recorded) -> tuple[int, int, float]:
    """Repeated samples, frozen frames, largest growth in mm; no fault."""
    tree, last = recording.tree(), {}
    repeated = frozen = 0
    largest_ns = 0
    for frame in recording.frames:
        for each in frame.poses:
            numbers = _numbers(each)
            repeated += numbers is not None and last.get(each.source) == numbers
            last[each.source] = numbers or last.get(each.source)
        tree.insert(frame)
        pose = tree.pose(recording.reference, recording.tool)
        frozen += Reason.FROZEN in pose.problems
        largest_ns = max(largest_ns, pose.unchanged_ns)
    return repeated, frozen, V_MAX_MM_S * largest_ns / NS_PER_S


def inject(recording: Recorded, at: int, sensors: tuple[str, ...]) -> Detection:
    """Repeat the poses of ``sensors`` in frame ``at`` in all later frames, and measure."""
    tree = recording.tree()
    for frame in recording.frames[: at + 1]:
        tree.insert(frame)
    held = {each.source: each.transform for each in recording.frames[at].poses}
    begin_ns = recording.frames[at].stamp.ns
    grows_ms: float | None = None
    for frame in _continued(recording.frames, at):
        poses = tuple(
            TrackedTransform.valid(held[each.source], each.stamp)
            if each.source in sensors and held.get(each.source) is not None
            else each
            for each in frame.poses
        )
        tree.insert(replace(frame, poses=poses))
        pose = tree.pose(recording.reference, recording.tool)
        elapsed_ms = (frame.stamp.ns - begin_ns) / NS_PER_MS
        if grows_ms is None and pose.unchanged_ns > 0:
            grows_ms = elapsed_ms
        if Reason.FROZEN in pose.problems:
            return Detection(grows_ms, elapsed_ms)
    return Detection(grows_ms, None)


def moments(recording: Recorded, moving: bool, count: int) -> list[int]:
    """Frames in which the tool moves, or rests, for the last 3 samples; none of them a repeat."""
    frames = recording.frames
    track = [_position(frame, recording.tool) for frame in frames]
    seen = [_position(frame, recording.reference) is not None for frame in frames]
    found = []
    for at in range(max(3, round(WARM_UP * len(frames))), len(frames) - 1):
        points = track[at - 3 : at + 1]
        if not seen[at] or any(point is None for point in points):
            continue
        stamps_ns = [frame.stamp.ns for frame in frames[at - 3 : at + 1]]
        way_mm = np.linalg.norm(np.diff(points, axis=0), axis=1)
        speeds = (NS_PER_S * way_mm / np.diff(stamps_ns)).tolist()
        if min(speeds) > MOVING_MM_S if moving else max(speeds) < RESTING_MM_S:
            found.append(at)
    random.Random(1).shuffle(found)
    return found[:count]


def _continued(frames: Sequence[TrackingFrame], at: int) -> Iterator[TrackingFrame]:
    """Frames after ``at`` for `HELD_NS`; after the end the recording goes on backwards."""
    period_ns = (frames[-1].stamp.ns - frames[0].stamp.ns) // (len(frames) - 1)
    now_ns, index, step = frames[at].stamp.ns, at, 1
    while now_ns < frames[at].stamp.ns + HELD_NS:
        if not 0 <= index + step < len(frames):
            step = -step
        index += step
        now_ns += period_ns
        stamp = Stamp(now_ns)
        poses = tuple(replace(each, stamp=stamp) for each in frames[index].poses)
        yield TrackingFrame(stamp, poses)


def _numbers(sample: TrackedTransform) -> tuple[bytes, bytes] | None:
    pose = sample.transform
    return None if pose is None else (pose.translation_mm.tobytes(), pose.rotation.tobytes())


def _position(frame: TrackingFrame, source: str) -> np.ndarray | None:
    for each in frame.poses:
        if each.source == source and each.transform is not None:
            return each.transform.translation_mm
    return None


def _way_mm(frames: Sequence[TrackingFrame], source: str) -> float:
    track = [point for frame in frames if (point := _position(frame, source)) is not None]
    return float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum()) if len(track) > 1 else 0.0
