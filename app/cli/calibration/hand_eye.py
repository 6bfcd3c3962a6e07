"""``marginguard calibrate hand-eye``: a robot's base from its poses and a sensor's that it held."""

import math
from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from app.case import Case, JointSample
from app.cli.calibration.calibration_result import Finding, Residuals
from app.cli.calibration.recording import Recording, ToolTrack
from app.geometry import NS_PER_MS, InputError, Stamp, Transform
from app.registration import predict_tre, select_poses, solve_robot_world
from app.robot import Robot, load_robot

MAX_JOINT_GAP_NS = 100 * NS_PER_MS
"""Joint samples that are further apart say nothing of the time between them."""


def find_hand_eye(recording: Recording, track: ToolTrack) -> Finding:
    """``reference_from_<base>``, and with it how the sensor sits on the robot's tool link."""
    case, base, link = _robot_of(recording)
    robot = load_robot(case.robot_urdf(), package_dirs=case.package_dirs)
    joints = sorted(
        (sample for frame in recording.frames for sample in frame.joints),
        key=lambda sample: sample.stamp.ns,
    )
    robot_poses, sensor_poses = [], []
    for sample in track.samples:
        root_from_link = _link_at(robot, link, joints, sample.stamp)
        if root_from_link is not None and sample.transform is not None:
            robot_poses.append(root_from_link.renamed(target=base))
            sensor_poses.append(sample.transform)
    if not robot_poses:
        raise InputError(f"{recording.path}: {len(joints)} joint samples, none beside a good pose")
    kept = select_poses(robot_poses)
    result = solve_robot_world(
        [robot_poses[index] for index in kept], [sensor_poses[index] for index in kept]
    )
    registration = result.registration
    residuals = Residuals(
        "distance of the sensor from where the robot has it",
        "mm",
        "number of the pose",
        registration.residuals_mm,
        outliers=result.outliers,
        leave_one_out=registration.leave_one_out_mm,
    )
    angles = np.degrees(np.delete(result.residuals_rad, result.outliers))
    centre = np.mean([sensor_poses[index].translation_mm for index in kept], axis=0)
    tip_mm = result.tip_from_sensor.inverse().translation_mm
    return Finding(
        kind="hand-eye",
        transform=registration.transform,
        accepted=result.accepted,
        reason=result.reason,
        numbers={
            "samples": len(robot_poses),
            "poses": len(kept),
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


def _robot_of(recording: Recording) -> tuple[Case, str, str]:
    case = recording.case
    if case is None or case.manifest.robot is None or not case.has_joints:
        raise InputError(f"{recording.path} has no joints: a case with robot.joint_states wanted")
    return case, case.manifest.robot.base_frame, case.manifest.robot.tool_link


def _link_at(
    robot: Robot, link: str, joints: Sequence[JointSample], stamp: Stamp
) -> Transform | None:
    """``root_from_link`` at ``stamp``, between the joint samples before and after it."""
    after = bisect_left(joints, stamp.ns, key=lambda sample: sample.stamp.ns)
    if after in (0, len(joints)):
        return None
    before, behind = joints[after - 1], joints[after]
    gap_ns = behind.stamp.ns - before.stamp.ns
    if gap_ns > MAX_JOINT_GAP_NS:
        return None
    first = robot.measured_kinematics(link, before.as_mapping())[link]
    second = robot.measured_kinematics(link, behind.as_mapping())[link]
    return first.interpolate(second, (stamp.ns - before.stamp.ns) / gap_ns)
