"""True motion of tool, tumour and robot: a part of the recorded case, played to and fro."""

import json
import time
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from app.case import Case, JointSample, TrackingFrame
from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.runtime import prepare_case
from app.session import Session
from benchmarks.harness.options import RECORDED_CASE
from benchmarks.harness.peer import to_and_fro

FIRST_FRAME, FRAMES = 100, 700
"""The tool moves between landmarks, 30 to 65 mm from the tumour; all poses are tracked."""

PERIOD_NS = 20_000_000
TOOL, TUMOR, REFERENCE, TRACKER = "cautery", "needle", "reference", "tracker"
EDGES = ((TRACKER, REFERENCE), (TRACKER, TUMOR), (TRACKER, TOOL))


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True situation at one time.

    ``approach`` (3,) is the unit vector from the tool to the tumour at their closest points in the
    tumour's frame; ``base_from_tumor`` (3, 3) turns it to the robot's base.
    """

    distance_mm: float
    approach: FloatArray
    base_from_tumor: FloatArray


@dataclass(slots=True, eq=False)
class Scene:
    """Frames of the motion, and the time at which each is true.

    Frame ``k`` is true at ``begin_ns + (k + shift) * PERIOD_NS``. ``rest_at`` is the frame at which
    the motion stands still, if it does.
    """

    truths: list[Truth]
    begin_ns: int
    shift: int = 0
    rest_at: int | None = None

    def at(self, ns: int) -> Truth:
        """The true situation at the system time ``ns``."""
        frame = self.rest_at
        if frame is None:
            frame = (ns - self.begin_ns) // PERIOD_NS - self.shift
        return self.truths[to_and_fro(frame, len(self.truths))]


def tracker_arguments(folder: Path, rate_hz: int) -> tuple[str, ...]:
    """Write a scene at ``rate_hz`` to ``folder``; the arguments of the process that sends it."""
    path = folder / "scene.json"
    write_scene(path, time.time_ns())
    path.write_text(json.dumps(interpolated(json.loads(path.read_text()), rate_hz)))
    return "-m", "benchmarks.faults.tracker_peer", str(path)


def write_scene(path: Path, begin_ns: int) -> Scene:
    """Write the frames for ``tracker_peer.py`` to ``path``; return what is true meanwhile."""
    prepared = prepare_case(RECORDED_CASE)
    session = Session(prepared.setup)
    frames: list[dict[str, Any]] = []
    truths = []
    for frame in _resampled(prepared.case, prepared.extent.first_ns, FIRST_FRAME + FRAMES + 1):
        step = session.step(frame)
        joint_names = list(frame.joints[0].names)
        if step.index < FIRST_FRAME:
            continue
        found = {pose.source: pose.transform for pose in frame.poses}
        constraint, proximity = step.decision.constraint, step.decision.proximity
        tool, needle = found[TOOL], found[TUMOR]
        if constraint is None or proximity is None or tool is None or needle is None:
            raise RuntimeError(f"frame {step.index} of {RECORDED_CASE} is not tracked")
        approach = -constraint.normals[0]
        tracker_from_tumor = needle @ prepared.setup.frame_from_tumor
        frames.append(
            {
                "edges": [_plain(found[child]) for _, child in EDGES],
                "joints": list(frame.joints[0].positions),
                "away": (-tracker_from_tumor.rotation @ approach).tolist(),
            }
        )
        truths.append(Truth(proximity.signed_distance_mm, approach, _base_from(step, prepared)))
        if len(frames) == FRAMES:
            break
    for frame, other in zip(frames, frames[1:] + frames[-2:-1], strict=True):
        moved = np.subtract(frame["edges"][2][:3], other["edges"][2][:3])
        frame["speed_mm_s"] = float(np.linalg.norm(moved)) * 1e12 / PERIOD_NS
    offset_ns = prepared.case.manifest.clock.offset_robot_to_tracker_ns
    document = {
        "period_ns": PERIOD_NS,
        "begin_ns": begin_ns,
        "edges": EDGES,
        "joint_names": joint_names,
        "joint_offset_ns": offset_ns,
        "frames": frames,
    }
    path.write_text(json.dumps(document))
    return Scene(truths, begin_ns)


def interpolated(scene: dict[str, Any], rate_hz: int) -> dict[str, Any]:
    """``scene`` with its rate raised to ``rate_hz`` by linear interpolation."""
    factor = round(rate_hz * scene["period_ns"] / 1e9)
    frames = [
        _between_frames(frame, after, part / factor)
        for frame, after in pairwise(scene["frames"])
        for part in range(factor)
    ]
    return {**scene, "frames": frames, "period_ns": scene["period_ns"] // factor}


def _between_frames(frame: dict[str, Any], after: dict[str, Any], part: float) -> dict[str, Any]:
    """Frame between two; quaternions of neighbours are close, so they are interpolated linearly."""
    first, second = np.array(frame["edges"]), np.array(after["edges"])
    turned = (first[:, 3:] * second[:, 3:]).sum(axis=1) < 0.0
    second[turned, 3:] *= -1.0
    edges = (1.0 - part) * first + part * second
    edges[:, 3:] /= np.linalg.norm(edges[:, 3:], axis=1, keepdims=True)
    joints = (1.0 - part) * np.array(frame["joints"]) + part * np.array(after["joints"])
    return {**frame, "edges": edges.tolist(), "joints": joints.tolist()}


def _base_from(step: Any, prepared: Any) -> FloatArray:
    """Rotation from the tumour to the robot's base (3, 3), by the session's registration."""
    robot = prepared.setup.robot
    registration = robot.registration.transform  # reference from base
    poses = {pose.source: pose.transform for pose in step.frame.poses}
    tracker_from_base = poses[REFERENCE] @ registration
    tracker_from_tumor = poses[TUMOR] @ prepared.setup.frame_from_tumor
    rotation: FloatArray = tracker_from_base.rotation.T @ tracker_from_tumor.rotation
    return rotation


def _plain(pose: Transform | None) -> list[float]:
    """Translation in m and quaternion xyzw."""
    if pose is None:
        raise RuntimeError(f"a pose of {RECORDED_CASE} is not tracked")
    return [*(pose.translation_mm / 1000.0), *pose.quaternion_xyzw]


def _resampled(case: Case, start_ns: int, count: int) -> Iterator[TrackingFrame]:
    """The first ``count`` frames from ``start_ns`` on, at `PERIOD_NS`.

    The tracker's samples are irregular and some are lost, so poses are interpolated between those
    that are valid: the bench adds its faults itself.
    """
    end_ns = start_ns + count * PERIOD_NS
    poses: dict[str, list[TrackedTransform]] = {child: [] for _, child in EDGES}
    joints: list[JointSample] = []
    for frame in case.recorded_frames():
        joints += frame.joints
        for sample in frame.poses:
            if sample.status is TrackingStatus.OK:
                poses[sample.source].append(sample)
        if frame.stamp.ns > end_ns + PERIOD_NS:
            break
    times_ns = np.array([sample.stamp.ns for sample in joints])
    positions = np.array([sample.positions for sample in joints])
    for index in range(1, count):
        stamp = Stamp(start_ns + index * PERIOD_NS, frame.stamp.clock)
        now = tuple(_between(poses[child], stamp) for _, child in EDGES)
        held = tuple(float(np.interp(stamp.ns, times_ns, column)) for column in positions.T)
        yield TrackingFrame(stamp, now, (JointSample(joints[0].names, held, stamp),))


def _between(samples: list[TrackedTransform], stamp: Stamp) -> TrackedTransform:
    """The pose at ``stamp``, from the valid samples before and after it."""
    after = bisect_right(samples, stamp.ns, key=lambda sample: sample.stamp.ns)
    first, second = samples[after - 1], samples[after]
    assert first.transform is not None and second.transform is not None
    fraction = (stamp.ns - first.stamp.ns) / (second.stamp.ns - first.stamp.ns)
    pose = first.transform.interpolate(second.transform, fraction)
    return TrackedTransform(pose, stamp, TrackingStatus.OK)
