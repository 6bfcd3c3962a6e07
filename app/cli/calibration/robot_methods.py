"""Methods of ``marginguard calibrate`` for the base of a robot: hand-eye, and that of its case."""

import argparse
import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import TYPE_CHECKING

from app.cli.calibration import CalibrationMethod, Input
from app.geometry import InputError

if TYPE_CHECKING:
    from app.case import Case, JointSample
    from app.cli.calibration.calibration_inputs import CalibrationInputs, Recording
    from app.cli.calibration.calibration_result import CalibrationResult
    from app.geometry import Stamp, Transform
    from app.registration import RegistrationResult
    from app.robot import Robot


MAX_JOINT_GAP_NS = 100_000_000
"""Largest interval between two joint samples within which joints are interpolated."""


def find_robot_base(inputs: "CalibrationInputs") -> "CalibrationResult":
    """Compute ``reference_from_<base>`` and the mount of the sensor on the robot's tool link."""
    import numpy as np

    from app.cli.calibration.calibration_result import CalibrationResult, Residuals
    from app.registration import predict_tre, select_poses, solve_robot_world
    from app.session import load_case_robot

    recording, track = inputs.recording, inputs.tool_track
    case, base, link = _case_with_joints(recording)
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
        outliers=result.outliers,
        leave_one_out=registration.leave_one_out_mm,
    )
    angles = np.degrees(np.delete(result.residuals_rad, result.outliers))
    centre = np.mean([sensor_poses[index].translation_mm for index in selected], axis=0)
    tip_mm = result.tip_from_sensor.inverse().translation_mm
    return CalibrationResult(
        kind="hand-eye",
        transform=registration.transform,
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            "samples": len(robot_poses),
            "poses": len(selected),
            "outliers": len(result.outliers),
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


def _case_with_joints(recording: "Recording") -> "tuple[Case, str, str]":
    """The case of the recording, the robot's base frame and its tool link."""
    case = recording.case
    if case is None or case.manifest.robot is None or not case.has_joints:
        raise InputError(f"{recording.path} has no joints; expected a case with robot.joint_states")
    return case, case.manifest.robot.base_frame, case.manifest.robot.tool_link


def _link_pose_at(
    robot: "Robot", link: str, joints: "Sequence[JointSample]", stamp: "Stamp"
) -> "Transform | None":
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


def robot_base_of_case(options: argparse.Namespace) -> "CalibrationResult":
    """Register the robot of a case as its manifest specifies."""
    from app.runtime import register_case

    registered = register_case(options.case, package_dirs=options.package_dirs)
    offset = registered.clock
    notes = () if offset is None else (f"clock offset estimated: {offset.reason}",)
    return _as_calibration_result(registered.registration, (*registered.case.notes(), *notes))


def _as_calibration_result(
    registration: "RegistrationResult", notes: tuple[str, ...]
) -> "CalibrationResult":
    from app.cli.calibration.calibration_result import CalibrationResult, Residuals

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


METHODS = (
    CalibrationMethod(
        name="hand-eye",
        summary="the base of a robot that held a tracked sensor in many poses",
        inputs=frozenset({Input.TOOL_TRACK, Input.JOINTS}),
        run=find_robot_base,
    ),
)
