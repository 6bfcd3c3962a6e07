"""Mean poses of the tool at rest on landmarks, by the tracker and by the robot."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.case import Dwell, JointSample, TrackingFrame
from app.geometry import NS_PER_S, InputError, Transform, mean_transform
from app.session.pose_tree import PoseTree, is_sampled
from app.session.setup import REFERENCE, RobotSetup

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
