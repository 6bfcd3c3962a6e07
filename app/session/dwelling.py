"""The tool at rest on landmarks: where the tracker and where the robot has it, dwell by dwell."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.case import Dwell, JointSample, TrackingFrame
from app.geometry import NS_PER_S, InputError, Transform, mean_transform
from app.session.pose_tree import PoseTree, is_sampled
from app.session.setup import REFERENCE, RobotSetup

MIN_SAMPLES = 5
"""Tracker frames and joint samples that a dwell needs, so that its mean says something."""

MAX_MOTION_MM = 1.0
"""RMS distance of the tip by the robot from its mean that still counts as dwelling."""

MAX_SEEN_MOTION_MM = 2.0
"""The same of the tip by the tracker: twice the noise of EM. It is more where the reference moves,
which the robot does not stand on (a chest that breathes)."""


@dataclass(frozen=True, slots=True, eq=False)
class DwellPose:
    """One dwell: the means of the tracked tool and of the robot's tool link."""

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
    """One `DwellPose` a dwell.

    ``frames`` are read up to the end of the last dwell and no further; ``poses`` is an empty tree
    with the staleness bounds to keep. Raises `InputError` for a dwell with too few good samples
    or with a tip that moved.
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
        tool = poses.pose(REFERENCE, tool_frame).transform
        # A pose that stands from an earlier frame is no sample more.
        if tool is not None and is_sampled(tool_frame, frame):
            for index in _dwells_at(dwells, frame.stamp.ns - start_ns):
                found[index].tool.append(tool)
        for joints in frame.joints:
            for index in _dwells_at(dwells, joints.stamp.ns - start_ns):
                found[index].link.append(_base_from_link(robot, joints))
    return tuple(
        _dwell_pose(samples, number, tool_from_tip) for number, samples in enumerate(found, start=1)
    )


def _dwells_at(dwells: Sequence[Dwell], since_start_ns: int) -> list[int]:
    at_s = since_start_ns / NS_PER_S
    return [index for index, dwell in enumerate(dwells) if dwell.start_s <= at_s <= dwell.end_s]


def _base_from_link(robot: RobotSetup, joints: JointSample) -> Transform:
    link = robot.tool_link
    root_from_link = robot.robot.measured_kinematics(link, joints.as_mapping())[link]
    return root_from_link.renamed(target=robot.base_frame)


def _dwell_pose(samples: _Samples, number: int, tool_from_tip: Transform) -> DwellPose:
    tracked = f"{tool_from_tip.target!r} in {REFERENCE!r}"
    for transforms, what in ((samples.tool, tracked), (samples.link, "the robot's joints")):
        if len(transforms) < MIN_SAMPLES:
            raise InputError(
                f"registration: dwell {number} has {len(transforms)} good samples of {what}, "
                f"at least {MIN_SAMPLES} wanted"
            )
    seen = [transform @ tool_from_tip for transform in samples.tool]
    for tips, what, most_mm in (
        (samples.link, "the robot's tip", MAX_MOTION_MM),
        (seen, f"the tip of {tracked}", MAX_SEEN_MOTION_MM),
    ):
        motion_mm = _motion_mm(tips)
        if motion_mm > most_mm:
            raise InputError(
                f"registration: {what} moved by {motion_mm:.2f} mm RMS in dwell {number}, "
                f"at most {most_mm} allowed"
            )
    return DwellPose(mean_transform(samples.tool), mean_transform(samples.link))


def _motion_mm(transforms: Sequence[Transform]) -> float:
    places = np.array([transform.translation_mm for transform in transforms])
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))
