"""The picture of the deepest moment, from 3D Slicer's scene where the machine can draw one."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.case import Case
    from app.session import SessionSetup, StepResult


def scene_picture(
    case: "Case", setup: "SessionSetup", deepest: "StepResult | None", *, with_tool: bool
) -> bytes | None:
    """``scene.png`` of the step ``deepest``; None, said on stderr, where it cannot be made."""
    if deepest is None:
        return None
    try:
        from app.scene import Moment, OffscreenError, SceneError, ShownRobot, moment_png
    except ImportError as error:
        print(f"no scene.png: {error}; 'marginguard doctor' says what to install", file=sys.stderr)
        return None
    robot = setup.robot
    moment = Moment(
        decision=deepest.decision,
        tumor=case.tumor_mesh(),
        tool=case.tool_mesh() if with_tool else None,
        tip_frame=case.manifest.tool.tip_frame,
        measured=tuple(
            pose.transform for pose in deepest.frame.poses if pose.transform is not None
        ),
        fixed=setup.static_edges,
        tumor_from_tip=deepest.tumor_from_tip,
        robot=ShownRobot(robot.robot, robot.base_frame, deepest.links, robot.tool_link)
        if robot is not None and deepest.links
        else None,
    )
    try:
        return moment_png(moment)
    except (OffscreenError, SceneError) as error:
        print(f"no scene.png: {error}", file=sys.stderr)
        return None
