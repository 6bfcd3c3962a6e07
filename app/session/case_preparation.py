"""Preparation of a case: repaired meshes, its registered robot, and the clock of its joints."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from app.case import (
    Case,
    Dwell,
    JointSample,
    MeshEntry,
    RegistrationEntry,
    ToolEntry,
    TrackingFrame,
    TumorEntry,
)
from app.fixture import MarginParameters
from app.geometry import (
    NS_PER_S,
    FloatArray,
    FreshnessLimits,
    InputError,
    Transform,
    mean_transform,
)
from app.registration import (
    RegistrationResult,
    TimedSignal,
    given_registration,
    register_points,
    solve_robot_world,
)
from app.robot import Robot, load_robot
from app.session.pose_tree import PoseRules, PoseTree, is_sampled
from app.session.setup import REFERENCE, RobotSetup

if TYPE_CHECKING:
    from app.registration import TimeOffset


def with_repaired_meshes(case: Case) -> Case:
    """``case`` with sound meshes where its manifest requests a repair, else ``case`` itself.

    The case's notes list the changes. Raises `MeshError` for a mesh without a safe repair.
    """
    # A mesh is never altered without an explicit request.
    manifest = case.manifest
    for structure in (manifest.tumor, *manifest.structures):
        if isinstance(structure.shape, MeshEntry) and structure.shape.repair:
            which = "the tumour" if structure is manifest.tumor else structure.key
            case = _repaired(case, structure, f"{which}'s mesh {structure.shape.path}")
    tools = {"the tool": manifest.tool}
    tools |= {f"tool {arm.name!r}": arm.tool for arm in manifest.other_arms}
    for which, tool in tools.items():
        if tool.mesh is not None and tool.mesh.repair:
            case = _repaired(case, tool, f"{which}'s mesh {tool.mesh.path}")
    return case


def _repaired(case: Case, of: TumorEntry | ToolEntry, what: str) -> Case:
    from app.fixture import repair_mesh  # imports scipy's sparse matrices, which is slow

    mesh, notes = repair_mesh(case.faulty_mesh(of), what)
    return case.with_repaired_mesh(of, mesh, notes)


def load_case_robot(case: Case) -> Robot:
    """Load the robot of ``case``. Raises `InputError` for a case without one, else as `load_robot`.

    Its warnings become notes of the case. Takes up to seconds, for its meshes.
    """
    entry = case.manifest.robot
    robot = load_robot(
        case.robot_urdf(),
        package_dirs=case.package_dirs,
        xacro_args={} if entry is None else entry.xacro_args,
        require_meshes=entry is None or entry.require_meshes,
    )
    case.add_notes([f"the robot: {warning}" for warning in robot.warnings])
    return robot


MIN_SAMPLES = 5
"""Fewest tracker frames and joint samples of a dwell whose mean is used."""

MAX_MOTION_MM = 1.0
"""Largest RMS distance of the robot's tip from its mean during a dwell."""

MAX_TRACKED_MOTION_MM = 2.0
"""The same for the tracked tip: twice the noise of EM tracking. It is larger than the robot's,
because the reference moves (breathing) and the robot's base does not."""


@dataclass(frozen=True, slots=True, eq=False)
class DwellPose:
    """Mean poses of one dwell: the tracked tool and the robot's tool link."""

    reference_from_tool: Transform
    base_from_link: Transform


@dataclass(slots=True)
class _Samples:
    tool: list[Transform] = field(default_factory=list)
    link: list[Transform] = field(default_factory=list)


def dwell_poses(
    frames: Iterable[TrackingFrame],
    dwells: Sequence[Dwell],
    poses: PoseTree,
    *,
    tool_from_tip: Transform,
    robot: RobotSetup,
) -> tuple[DwellPose, ...]:
    """Mean poses, one `DwellPose` per dwell.

    ``frames`` are read up to the end of the last dwell and no further; ``poses`` is an empty tree
    with the freshness limits to apply. Raises `InputError` for a dwell with too few good samples
    or with a moving tip.
    """
    tool_frame = tool_from_tip.target
    found = [_Samples() for _ in dwells]
    last_end_s = max(dwell.end_s for dwell in dwells)
    start_ns: int | None = None
    for frame in frames:
        start_ns = frame.stamp.ns if start_ns is None else start_ns
        if (frame.stamp.ns - start_ns) / NS_PER_S > last_end_s:
            break
        poses.insert(frame)
        present = _dwells_at(dwells, frame.stamp.ns - start_ns)
        # A pose that is only repeated from an earlier frame is not counted again.
        if present and is_sampled(tool_frame, frame):
            tool = poses.pose(REFERENCE, tool_frame).transform
            if tool is not None:
                for index in present:
                    found[index].tool.append(tool)
        for joints in frame.joints:
            for index in _dwells_at(dwells, joints.stamp.ns - start_ns):
                found[index].link.append(_base_from_link(robot, joints))
    return tuple(
        mean_dwell_pose(samples.tool, samples.link, f"dwell {number}", tool_from_tip)
        for number, samples in enumerate(found, start=1)
    )


def _dwells_at(dwells: Sequence[Dwell], since_start_ns: int) -> list[int]:
    at_s = since_start_ns / NS_PER_S
    return [index for index, dwell in enumerate(dwells) if dwell.start_s <= at_s <= dwell.end_s]


def _base_from_link(robot: RobotSetup, joints: JointSample) -> Transform:
    link = robot.tool_link
    root_from_link = robot.robot.measured_kinematics(link, joints.as_mapping())[link]
    return root_from_link.renamed(target=robot.base_frame)


def mean_dwell_pose(
    reference_from_tool: Sequence[Transform],
    base_from_link: Sequence[Transform],
    dwell: str,
    tool_from_tip: Transform,
) -> DwellPose:
    """Mean poses of a dwell. Raises `InputError`, with its name, for few samples or motion."""
    tracked = f"{tool_from_tip.target!r} in {REFERENCE!r}"
    for transforms, what in (
        (reference_from_tool, tracked),
        (base_from_link, "the robot's joints"),
    ):
        if len(transforms) < MIN_SAMPLES:
            raise InputError(
                f"registration: {dwell} has {len(transforms)} good samples of {what}; "
                f"expected at least {MIN_SAMPLES}"
            )
    tracked_tips = [transform @ tool_from_tip for transform in reference_from_tool]
    for tips, what, max_mm in (
        (base_from_link, "the robot's tip", MAX_MOTION_MM),
        (tracked_tips, f"the tip of {tracked}", MAX_TRACKED_MOTION_MM),
    ):
        motion_mm = _motion_mm(tips)
        if motion_mm > max_mm:
            raise InputError(
                f"registration: {what} moved by {motion_mm:.2f} mm RMS in {dwell}; "
                f"expected at most {max_mm}"
            )
    return DwellPose(mean_transform(reference_from_tool), mean_transform(base_from_link))


def _motion_mm(transforms: Sequence[Transform]) -> float:
    places = np.array([transform.translation_mm for transform in transforms])
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


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
    poses = PoseTree(PoseRules(margins.freshness_limits, (tool.frame,)))
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
    return (reference_from_frame @ tumor.frame_from_tumor).apply(case.tumor_mesh().box_corners_mm)


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
    poses = PoseTree(PoseRules(limits, (tool.frame,)))
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
