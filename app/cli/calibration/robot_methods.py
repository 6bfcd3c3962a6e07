"""Methods of ``marginguard calibrate`` for clocks (lag, time) and for the base of a robot."""

import argparse
import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.case import JointSample
from app.cli.calibration.calibration_inputs import (
    CalibrationInputs,
    TimeSpan,
    extract_tool_track,
    open_recording,
)
from app.cli.calibration.calibration_result import CalibrationResult, Residuals
from app.files.numbers import SIGNAL_ENDING, read_signal
from app.geometry import NS_PER_MS, InputError, Stamp, Transform
from app.registration import (
    RegistrationResult,
    TimedSignal,
    estimate_time_offset,
    predict_tre,
    select_poses,
    solve_robot_world,
)
from app.robot import Robot
from app.runtime import register_case
from app.session import load_case_robot, tip_signals


def find_lag(inputs: CalibrationInputs) -> CalibrationResult:
    """Estimate how much more the clock of the other signal reads than the recording's.

    One signal is fitted as a linear function of the one with more values. So positions by a tracker
    explain the position of a line in a video, whatever the pose of the camera and its scale.
    """
    track = inputs.tool_track
    first = TimedSignal.from_positions(track.samples)
    second, notes = _other_signal(inputs)
    around_ns = round(inputs.options.around_ms * NS_PER_MS)
    is_swapped = first.values.shape[1] < second.values.shape[1]
    a, b, sign = (second, first, -1) if is_swapped else (first, second, 1)
    offset = estimate_time_offset(a, b, around_ns=sign * around_ns)
    low_ns, high_ns = sorted(sign * each for each in offset.interval_ns)
    return CalibrationResult(
        kind="lag",
        transform=None,
        accepted=offset.accepted,
        reason=offset.reason if sign > 0 else f"{offset.reason} (from the other to this signal)",
        numbers={
            "samples": len(first.times_ns),
            "other_samples": len(second.times_ns),
            "offset_ms": sign * offset.offset_ns / NS_PER_MS,
            "interval_low_ms": low_ns / NS_PER_MS,
            "interval_high_ms": high_ns / NS_PER_MS,
            "explained": offset.explained,
        },
        notes=(*track.notes, *notes),
    )


def _other_signal(inputs: CalibrationInputs) -> tuple[TimedSignal, tuple[str, ...]]:
    path: Path = inputs.options.other
    if path.suffix.lower() == SIGNAL_ENDING:
        times, values = read_signal(path)
        return TimedSignal(np.array(times, dtype=np.int64), values, path.name), ()
    other = open_recording(path, TimeSpan(), package_dirs=inputs.options.package_dirs)
    track = extract_tool_track(
        other,
        tool=inputs.options.other_tool,
        reference=None,
        max_age_ms=inputs.options.max_age_ms,
    )
    return TimedSignal.from_positions(track.samples), track.notes


def find_time_offset(inputs: CalibrationInputs) -> CalibrationResult:
    """Estimate what to add to the robot's time, from the tip's motion as both measured it.

    The offset that the case states is not used.
    """
    # Apply the guess while reading, so that frames pair joints with poses of the same time.
    around_ns = round(inputs.options.around_ms * NS_PER_MS)
    shifted = inputs.case.with_joint_offset(around_ns)
    by_robot, by_tracker = tip_signals(inputs.case, inputs.span.select(shifted.frames()))
    by_robot = replace(by_robot, times_ns=by_robot.times_ns - around_ns)
    offset = estimate_time_offset(by_robot, by_tracker, around_ns=around_ns)
    low_ns, high_ns = offset.interval_ns
    return CalibrationResult(
        kind="time",
        transform=None,
        accepted=offset.accepted,
        reason=offset.reason,
        numbers={
            "joint_samples": len(by_robot.times_ns),
            "poses": len(by_tracker.times_ns),
            "offset_robot_to_tracker_ms": offset.offset_ns / NS_PER_MS,
            "interval_low_ms": low_ns / NS_PER_MS,
            "interval_high_ms": high_ns / NS_PER_MS,
            "explained": offset.explained,
        },
        notes=shifted.notes(),
    )


MAX_JOINT_GAP_NS = 100_000_000
"""Largest interval between two joint samples within which joints are interpolated."""


def find_robot_base(inputs: CalibrationInputs) -> CalibrationResult:
    """Compute ``reference_from_<base>`` and the mount of the sensor on the robot's tool link."""
    recording, track = inputs.recording, inputs.tool_track
    case = recording.case
    if case is None or case.manifest.robot is None or not case.has_joints:
        raise InputError(f"{recording.path} has no joints; expected a case with robot.joint_states")
    base, link = case.manifest.robot.base_frame, case.manifest.robot.tool_link
    robot = load_case_robot(case)
    joints = sorted(
        (sample for frame in recording.frames for sample in frame.joints),
        key=lambda sample: sample.stamp.ns,
    )
    robot_poses, sensor_poses = [], []
    for sample in track.samples:
        root_from_link = _link_pose_at(robot, link, joints, sample.stamp)
        if root_from_link is not None and sample.transform is not None:
            robot_poses.append(root_from_link.renamed(target=base))
            sensor_poses.append(sample.transform)
    if not robot_poses:
        raise InputError(
            f"{recording.path}: none of {len(joints)} joint samples is close in time to a valid "
            f"pose; expected joint samples at most {MAX_JOINT_GAP_NS // 1_000_000} ms apart"
        )
    selected = select_poses(robot_poses)
    result = solve_robot_world(
        [robot_poses[index] for index in selected], [sensor_poses[index] for index in selected]
    )
    registration = result.registration
    residuals = Residuals(
        "distance of the sensor from its position by kinematics",
        "mm",
        "number of the pose",
        registration.residuals_mm,
        outliers=registration.outliers,
        leave_one_out=registration.leave_one_out_mm,
    )
    angles = np.degrees(np.delete(result.residuals_rad, registration.outliers))
    centre = np.mean([sensor_poses[index].translation_mm for index in selected], axis=0)
    tip_mm = result.tip_from_sensor.inverse().translation_mm
    return CalibrationResult(
        kind="hand-eye",
        transform=registration.transform,
        accepted=registration.accepted,
        reason=registration.reason,
        numbers={
            "samples": len(robot_poses),
            "poses": len(selected),
            "outliers": len(registration.outliers),
            "rms_mm": residuals.rms,
            "max_mm": residuals.largest,
            "rotation_rms_deg": float(np.sqrt(np.mean(angles**2))),
            "rotation_max_deg": float(angles.max()),
            "sigma_at_centre_mm": float(predict_tre(registration, centre[None])[0]),
            "sigma_of_base_deg": math.degrees(
                math.sqrt(float(np.trace(result.covariance[:3, :3])))
            ),
            "condition": registration.condition,
            "tip_from_where_the_case_has_it_mm": float(
                np.linalg.norm(tip_mm - case.manifest.tool.tool_from_tip.translation_mm)
            ),
        },
        residuals=residuals,
        others=(result.tip_from_sensor,),
        notes=track.notes,
    )


def _link_pose_at(
    robot: Robot, link: str, joints: Sequence[JointSample], stamp: Stamp
) -> Transform | None:
    """``root_from_link`` at ``stamp``, interpolated between the samples before and after it.

    None if one of them does not exist or if they are more than `MAX_JOINT_GAP_NS` apart.
    """
    index = bisect_left(joints, stamp.ns, key=lambda sample: sample.stamp.ns)
    if index in (0, len(joints)):
        return None
    before, after = joints[index - 1], joints[index]
    gap_ns = after.stamp.ns - before.stamp.ns
    if gap_ns > MAX_JOINT_GAP_NS:
        return None
    first = robot.measured_kinematics(link, before.as_mapping())[link]
    second = robot.measured_kinematics(link, after.as_mapping())[link]
    return first.interpolate(second, (stamp.ns - before.stamp.ns) / gap_ns)


def robot_base_of_case(options: argparse.Namespace) -> CalibrationResult:
    """Register the robot of a case as its manifest specifies."""
    registered = register_case(options.case, package_dirs=options.package_dirs)
    offset = registered.clock
    notes = () if offset is None else (f"clock offset estimated: {offset.reason}",)
    return _as_calibration_result(registered.registration, (*registered.case.notes(), *notes))


def _as_calibration_result(
    registration: RegistrationResult, notes: tuple[str, ...]
) -> CalibrationResult:
    residuals = None
    numbers: dict[str, float] = {}
    if len(registration.residuals_mm):
        residuals = Residuals(
            "distance of the moved point from its partner",
            "mm",
            "number of the pair",
            registration.residuals_mm,
            labels=tuple(str(number) for number in range(1, len(registration.residuals_mm) + 1)),
            outliers=registration.outliers,
            leave_one_out=registration.leave_one_out_mm,
        )
        numbers = {
            "points": len(registration.residuals_mm),
            "outliers": len(registration.outliers),
            "rms_mm": residuals.rms,
            "max_mm": residuals.largest,
            "condition": registration.condition,
        }
    return CalibrationResult(
        kind=registration.method.replace("_", " "),
        transform=registration.transform,
        accepted=registration.accepted,
        reason=registration.reason,
        numbers=numbers,
        residuals=residuals,
        notes=notes,
    )
