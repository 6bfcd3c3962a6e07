"""True motion of tool, tumour and robot: a part of the recorded case, played to and fro."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.geometry import NS_PER_S, FloatArray
from app.runtime import prepare_case
from app.session import Session
from benchmarks.harness.options import RECORDED_CASE
from benchmarks.harness.peer import to_and_fro
from benchmarks.session import Trajectory

FIRST_S, LENGTH_S = 2.0, 14.0  # the tool moves between landmarks, 30 to 65 mm from the tumour
RATE_HZ = 50
PERIOD_NS = NS_PER_S // RATE_HZ
TOOL, TUMOR, REFERENCE, TRACKER = "cautery", "needle", "reference", "tracker"
EDGES = ((TRACKER, REFERENCE), (TRACKER, TUMOR), (TRACKER, TOOL))


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True situation at one time.

    ``approach`` (3,) is the unit vector from the tool to the tumour at their closest points in the
    tumour's frame; ``base_from_tumor`` (3, 3) turns it to the robot's base.
    """

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
    write_scene(path, time.time_ns(), rate_hz)
    return "-m", "benchmarks.faults.tracker_peer", str(path)


def write_scene(path: Path, begin_ns: int, rate_hz: int = RATE_HZ) -> Scene:
    """Write the frames for ``tracker_peer.py`` to ``path``; return what is true meanwhile.

    Poses are interpolated between those that are valid: the bench adds its faults itself.
    """
    prepared = prepare_case(RECORDED_CASE)
    session = Session(prepared.setup)
    recorded = Trajectory(list(prepared.case.recorded_frames()), rate_hz)
    first, count = round(FIRST_S * rate_hz), round(LENGTH_S * rate_hz)
    frames: list[dict[str, Any]] = []
    truths = []
    for frame in recorded.frames(first + count):
        step = session.step(frame)
        if step.index < first:
            continue
        poses = {pose.source: pose.transform for pose in frame.poses if pose.transform is not None}
        constraint = step.decision.constraint
        if constraint is None:
            raise RuntimeError(f"frame {step.index} of {RECORDED_CASE} is not tracked")
        approach = -constraint.normals[0]
        tracker_from_tumor = poses[TUMOR] @ prepared.setup.frame_from_tumor
        away = (-tracker_from_tumor.rotation @ approach).tolist()
        sensors = [poses[child] for _, child in EDGES]
        edges = [[*(each.translation_mm / 1000.0), *each.quaternion_xyzw] for each in sensors]
        frames.append({"edges": edges, "joints": list(frame.joints[0].positions), "away": away})
        registration = prepared.setup.robot.registration.transform  # reference from base
        tracker_from_base = poses[REFERENCE] @ registration
        turn = tracker_from_base.rotation.T @ tracker_from_tumor.rotation
        truths.append(Truth(approach, turn))
    for one, other in zip(frames, frames[1:] + frames[-2:-1], strict=True):
        moved = np.subtract(one["edges"][2][:3], other["edges"][2][:3])
        one["speed_mm_s"] = 1000.0 * float(np.linalg.norm(moved)) * rate_hz
    document = {
        "period_ns": NS_PER_S // rate_hz,
        "begin_ns": begin_ns,
        "edges": EDGES,
        "joint_names": list(frame.joints[0].names),
        "joint_offset_ns": prepared.case.manifest.clock.offset_robot_to_tracker_ns,
        "frames": frames,
    }
    path.write_text(json.dumps(document))
    return Scene(truths, begin_ns)
