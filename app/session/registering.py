"""Registration of a case's robot, as its manifest asks for."""

from collections.abc import Iterable, Sequence

import numpy as np

from app.case import Dwell, JointSample, TrackingFrame
from app.geometry import NS_PER_S, FloatArray, InputError, Transform
from app.registration import RegistrationResult, register_points
from app.robot import Robot
from app.session.pose_tree import PoseTree
from app.session.setup import REFERENCE

MIN_DWELL_SAMPLES = 5
"""Tracker frames and joint samples that a dwell needs, so that its mean says something."""

MAX_DWELL_MOTION_MM = 1.0
"""RMS distance of the robot's tip from its mean that still counts as dwelling."""


def register_at_dwells(
    frames: Iterable[TrackingFrame],
    dwells: Sequence[Dwell],
    poses: PoseTree,
    *,
    tool_from_tip: Transform,
    robot: Robot,
    base_frame: str,
    tool_link: str,
) -> RegistrationResult:
    """``reference_from_<base_frame>`` from the places where the tool's tip dwelt.

    At each dwell the tip is known twice: by the tracker in the reference frame, and by the
    robot's joints in its base frame (origin of ``tool_link``). The two means are a pair of
    points. ``frames`` are read up to the end of the last dwell and no further; ``poses`` is an
    empty tree with the staleness bounds to keep. Raises `InputError` for a dwell with too few
    good samples or with a tip that moved.
    """
    by_tracker: list[list[FloatArray]] = [[] for _ in dwells]
    by_robot: list[list[FloatArray]] = [[] for _ in dwells]
    last_end_s = max(dwell.end_s for dwell in dwells)
    start_ns: int | None = None
    for frame in frames:
        start_ns = frame.stamp.ns if start_ns is None else start_ns
        if (frame.stamp.ns - start_ns) / NS_PER_S > last_end_s:
            break
        poses.insert(frame)
        tool = poses.pose(REFERENCE, tool_from_tip.target)
        for index in _dwells_at(dwells, frame.stamp.ns - start_ns):
            if tool.transform is not None and frame.poses:
                by_tracker[index].append(tool.transform.apply(tool_from_tip.translation_mm))
        for joints in frame.joints:
            for index in _dwells_at(dwells, joints.stamp.ns - start_ns):
                by_robot[index].append(_tip_in_base(robot, joints, tool_link))
    fixed = [_mean(tips, f"dwell {n} by the tracker", None) for n, tips in enumerate(by_tracker)]
    moving = [
        _mean(tips, f"dwell {n} by the robot", MAX_DWELL_MOTION_MM)
        for n, tips in enumerate(by_robot)
    ]
    return register_points(
        np.array(fixed), np.array(moving), fixed_frame=REFERENCE, moving_frame=base_frame
    )


def _dwells_at(dwells: Sequence[Dwell], since_start_ns: int) -> list[int]:
    at_s = since_start_ns / NS_PER_S
    return [index for index, dwell in enumerate(dwells) if dwell.start_s <= at_s <= dwell.end_s]


def _tip_in_base(robot: Robot, joints: JointSample, tool_link: str) -> FloatArray:
    return robot.forward_kinematics(joints.as_mapping())[tool_link].translation_mm


def _mean(tips: list[FloatArray], what: str, max_motion_mm: float | None) -> FloatArray:
    if len(tips) < MIN_DWELL_SAMPLES:
        raise InputError(
            f"registration: {what} has {len(tips)} good samples, "
            f"at least {MIN_DWELL_SAMPLES} wanted"
        )
    points = np.array(tips)
    mean = points.mean(axis=0)
    motion_mm = float(np.sqrt(((points - mean) ** 2).sum(axis=1).mean()))
    if max_motion_mm is not None and motion_mm > max_motion_mm:
        raise InputError(
            f"registration: the tip moved by {motion_mm:.2f} mm RMS in {what}, "
            f"at most {max_motion_mm} allowed"
        )
    return np.asarray(mean)
