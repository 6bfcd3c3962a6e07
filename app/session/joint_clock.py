"""Offset between the robot's clock and the tracker's, estimated from motion that both recorded."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from app.case import Case, TrackingFrame
from app.geometry import FloatArray, FreshnessLimits, InputError
from app.registration import TimedSignal
from app.session.case_robot import load_case_robot
from app.session.pose_tree import PoseTree, is_sampled
from app.session.setup import REFERENCE

if TYPE_CHECKING:
    from app.registration import TimeOffset

ROBOT_CLOCK = "robot"


def with_estimated_clock(case: Case) -> tuple[Case, "TimeOffset | None"]:
    """``case`` with the offset of its joints' clock estimated, if its manifest requests it.

    Reads the whole recording then. Raises `InputError` if the motion does not determine the offset
    accurately enough.
    """
    if not (case.manifest.clock.estimate and case.has_joints):
        return case, None
    from app.registration import estimate_time_offset  # imports scipy's splines, which is slow

    by_robot, by_tracker = tip_signals(case, case.with_joint_offset(0).frames())
    offset = estimate_time_offset(by_robot, by_tracker)
    if not offset.accepted:
        raise InputError(f"case.yaml: clock.estimate: {offset.reason}")
    return case.with_joint_offset(offset.offset_ns), offset


def tip_signals(case: Case, frames: Iterable[TrackingFrame]) -> tuple[TimedSignal, TimedSignal]:
    """Tip positions (n, 3) in mm: by the joints on the robot's clock, and by the tracker.

    ``frames`` are those of ``case``, or a part of them, with joints stamped by the robot's clock.
    Raises `InputError` for a case without joints and for frames without usable samples.
    """
    manifest = case.manifest
    if manifest.robot is None or not case.has_joints:
        raise InputError(f"{case.folder} has no joints; expected a case with robot.joint_states")
    margins, tool, tool_link = manifest.margins, manifest.tool, manifest.robot.tool_link
    limits = FreshnessLimits(margins.stale_after_ns, margins.frozen_after_ns)
    poses = PoseTree(limits, (tool.frame,))
    robot = load_case_robot(case)
    joint_times: list[int] = []
    joint_tips: list[FloatArray] = []
    times: list[int] = []
    tips: list[FloatArray] = []
    for frame in frames:
        for joints in frame.joints:
            link = robot.measured_kinematics(tool_link, joints.as_mapping())[tool_link]
            joint_times.append(joints.stamp.ns)
            joint_tips.append(link.translation_mm)
        poses.insert(frame)
        reference_from_tool = poses.pose(REFERENCE, tool.frame).transform
        if reference_from_tool is not None and is_sampled(tool.frame, frame):
            times.append(frame.stamp.ns)
            tips.append(reference_from_tool.apply(tool.tool_from_tip.translation_mm))
    if not (joint_times and times):
        raise InputError(
            f"clock.estimate: {len(joint_times)} joint samples and {len(times)} poses of "
            f"{tool.frame!r} in {REFERENCE!r}; expected some of both"
        )
    return (
        TimedSignal(np.array(joint_times), np.array(joint_tips), ROBOT_CLOCK),
        TimedSignal(np.array(times), np.array(tips), frame.stamp.clock),
    )
