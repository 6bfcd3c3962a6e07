"""Registration of a case's robot by the method that its manifest names."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from app.case import Case, RegistrationEntry
from app.fixture import MarginParameters
from app.geometry import FloatArray, InputError, SurfaceMesh, Transform, mean_transform
from app.registration import (
    RegistrationResult,
    given_registration,
    register_points,
    solve_robot_world,
)
from app.session.dwelling import DwellPose, dwell_poses
from app.session.pose_tree import PoseTree
from app.session.setup import REFERENCE, RobotSetup


def register_robot(
    case: Case, robot: RobotSetup, margins: MarginParameters
) -> tuple[RegistrationResult, Transform | None]:
    """``reference_from_<base_frame>``, and ``link_from_tip`` if the data determine it.

    Reads the recording up to its last dwell if the method needs dwells. ``link_from_tip`` is the
    mount of the tool on the robot's link; its translation is zero by definition. Raises
    `InputError` for a case without a registration entry.
    """
    entry = case.manifest.registration
    if entry is None:
        raise InputError(
            f"case {case.manifest.name!r} has a robot but no registration; expected one"
        )
    if entry.reference_from_base is not None:
        covariance = None if entry.covariance is None else np.array(entry.covariance).reshape(6, 6)
        known = entry.reference_from_base, covariance, entry.degrees_of_freedom
        return given_registration(*known), None
    if entry.fixed_mm:
        return register_points(
            entry.fixed_mm,
            entry.moving_mm,
            fixed_frame=REFERENCE,
            moving_frame=robot.base_frame,
        ), None
    return _register_dwells(case, entry, robot, margins)


def _register_dwells(
    case: Case, entry: RegistrationEntry, robot: RobotSetup, margins: MarginParameters
) -> tuple[RegistrationResult, Transform]:
    tool = case.manifest.tool
    poses = PoseTree(margins.freshness_limits, (tool.frame,))
    dwells = dwell_poses(
        case.frames(), entry.dwells, poses, tool_from_tip=tool.tool_from_tip, robot=robot
    )
    targets_mm = _tumor_mm(case, poses)
    if entry.method == "robot_world":
        solved = solve_robot_world(
            [dwell.base_from_link for dwell in dwells],
            [dwell.reference_from_tool for dwell in dwells],
            targets_mm=targets_mm,
        )
        return solved.registration, solved.tip_from_sensor @ tool.tool_from_tip
    tip_mm = tool.tool_from_tip.translation_mm
    result = register_points(
        np.array([dwell.reference_from_tool.apply(tip_mm) for dwell in dwells]),
        np.array([dwell.base_from_link.translation_mm for dwell in dwells]),
        fixed_frame=REFERENCE,
        moving_frame=robot.base_frame,
        targets_mm=targets_mm,
    )
    return result, _mount(dwells, result.transform, tool.tool_from_tip)


def _tumor_mm(case: Case, poses: PoseTree) -> FloatArray | None:
    """Corners (8, 3) of the tumour's bounding box in ``reference``: where accuracy is needed.

    None while the tumour is not tracked; the registration's own points are then the targets.
    """
    tumor = case.manifest.tumor
    reference_from_frame = poses.pose(REFERENCE, tumor.frame).transform
    if reference_from_frame is None:
        return None
    return (reference_from_frame @ tumor.frame_from_tumor).apply(box_corners(case.tumor_mesh()))


def box_corners(mesh: SurfaceMesh) -> FloatArray:
    """Corners (8, 3) in mm of the bounding box of ``mesh``, in its frame."""
    return np.array(list(product(*zip(*mesh.bounds_mm, strict=True))))


def _mount(
    dwells: Sequence[DwellPose], reference_from_base: Transform, tool_from_tip: Transform
) -> Transform:
    link_from_tip = mean_transform(
        [
            (reference_from_base @ dwell.base_from_link).inverse()
            @ dwell.reference_from_tool
            @ tool_from_tip
            for dwell in dwells
        ]
    )
    return Transform(
        link_from_tip.target, link_from_tip.source, link_from_tip.rotation, np.zeros(3)
    )
