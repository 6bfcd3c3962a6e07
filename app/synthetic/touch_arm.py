"""Kinematics of the Touch desktop arm for the simulation of a case."""

from collections.abc import Mapping, Sequence

from app.files.packages import shipped
from app.geometry import Transform
from app.robot import load_robot

TOUCH_URDF = shipped("data", "robots", "touch", "touch.urdf")
TOOL_LINK = "stylus"


class TouchArm:
    """The kinematics of ``data/robots/touch``; the tool's tip is the origin of its ``stylus``."""

    def __init__(self, *, base_frame: str, tip_frame: str) -> None:
        self._robot = load_robot(TOUCH_URDF)
        self._base_frame, self._tip_frame = base_frame, tip_frame

    @property
    def joint_names(self) -> Sequence[str]:
        """Names of the joints, in the order of the joint states."""
        return self._robot.actuated_joint_names

    def base_from_tool(self, joints: Mapping[str, float]) -> Transform:
        """Pose of the tip in the base frame for ``joints`` (rad)."""
        root_from_tip = self._robot.forward_kinematics(joints)[TOOL_LINK]
        return root_from_tip.renamed(target=self._base_frame, source=self._tip_frame)

    def joints_for(
        self, base_from_tool: Transform, seed: Mapping[str, float] | None
    ) -> Mapping[str, float]:
        """Joints (rad) near ``seed`` that reach the pose; raises `UnreachableError` if none do."""
        root_from_tip = base_from_tool.renamed(target=self._robot.root_link, source=TOOL_LINK)
        return self._robot.inverse_kinematics(TOOL_LINK, root_from_tip, seed=seed)
