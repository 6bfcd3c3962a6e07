"""A copy of a simulated case whose poses have white noise and no other error.

The predictions of a calibration are of noise alone. A realistic case has distortion, encoders and
calibrations with errors as well, which no residual can show.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml

from app.case import TrackingFrame, open_case, write_recording
from app.geometry import NS_PER_S, TrackedTransform, TrackingStatus, Transform
from app.synthetic.motion import TouchArm
from app.synthetic.simulated_tracker import SimulatedTracker
from app.synthetic.simulation import TOOL_FROM_TIP
from app.synthetic.tracker_model import Jitter, TrackerModel


def write_white_case(
    case: Path, folder: Path, reference_from_base: Transform, seconds: float
) -> Path:
    """Write the first ``seconds`` of ``case`` to ``folder``: its joints, and poses by them.

    The poses of the reference and the cautery are those of the arm's kinematics at the joints,
    interpolated at the stamp of the frame, with 0.3 mm and 0.3 degrees of jitter in each sensor.
    """
    shutil.copytree(case, folder, ignore=shutil.ignore_patterns("*.mcap"))
    manifest = yaml.safe_load((case / "case.yaml").read_text())
    manifest["recording"] = {"path": "tracking.mcap"}
    manifest["tool"]["tip_from"] = {"matrix": TOOL_FROM_TIP.matrix.ravel().tolist()}
    (folder / "case.yaml").write_text(yaml.safe_dump(manifest))
    write_recording(
        folder / "tracking.mcap",
        _frames(case, reference_from_base, seconds),
        robot_to_tracker_offset_ns=round(manifest["clock"]["offset_robot_to_tracker_ms"] * 1e6),
    )
    return folder


def _frames(case: Path, reference_from_base: Transform, seconds: float) -> Iterator[TrackingFrame]:
    recorded = []
    for frame in open_case(case).recorded_frames():
        recorded.append(frame)
        if frame.stamp.ns - recorded[0].stamp.ns > seconds * NS_PER_S:
            break
    samples = [sample for frame in recorded for sample in frame.joints]
    times_ns = np.array([sample.stamp.ns for sample in samples])
    positions = np.array([sample.positions for sample in samples])
    names = samples[0].names
    arm = TouchArm()
    tracker = SimulatedTracker(TrackerModel("white", 50.0, Jitter()), [1])
    tracker_from_reference = Transform("tracker", "reference", np.eye(3), [10.0, 20.0, 30.0])
    for frame in recorded:
        joints = [float(np.interp(frame.stamp.ns, times_ns, column)) for column in positions.T]
        base_from_tip = arm.base_from_tool(dict(zip(names, joints, strict=True)))
        tool = reference_from_base @ base_from_tip @ TOOL_FROM_TIP.inverse()
        poses = tuple(
            TrackedTransform(
                tracker.measure(pose.source, pose, 0.0), frame.stamp, TrackingStatus.OK
            )
            for pose in (tracker_from_reference, tracker_from_reference @ tool)
        )
        yield TrackingFrame(frame.stamp, poses, joints=frame.joints)
