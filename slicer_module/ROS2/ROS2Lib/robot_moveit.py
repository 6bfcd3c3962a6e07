"""Inverse kinematics of a running MoveIt, by the calls of SlicerROS2's robots."""

import logging
from collections.abc import Sequence
from typing import Any

from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.bridge.calls import ServiceClient
from app.bridge.robot_description import RobotSettings
from app.geometry import NS_PER_S, MarginGuardError
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Owner
from ROS2Lib.robot_kinematics import RobotKinematics, joined
from ROS2Lib.vtk_values import translation_and_rotation

SERVICE = "/compute_ik"
_TYPE = "moveit_msgs/srv/GetPositionIK"
_DISCOVERY_S = 2.0
_TRANSPORT_S = 2.0
"""Time in addition to MoveIt's own timeout that a reply may take."""
_SUCCESS = 1


class RobotMoveIt(RobotKinematics):
    """Asks ``/compute_ik`` of move_group. SlicerROS2 runs MoveIt's solver in Slicer's process.

    The calls wait for the reply in the scene's thread, as in SlicerROS2.
    """

    _owner: Owner | None = None
    _settings: RobotSettings | None = None
    _group = ""
    _ik: ServiceClient | None = None

    def SetupIKMoveIt(self, groupName: str) -> bool:
        """Choose MoveIt's planning group; False, with a log line, if MoveIt does not answer."""
        try:
            if self._owner is None or self._robot is None:
                raise Ros2Error("the robot has no description yet")
            if not groupName:
                raise Ros2Error("planning group is empty; expected its name")
            if self._ik is None:
                self._ik = ServiceClient(self._owner.ros, _TYPE, SERVICE)
            self._ik.wait(_DISCOVERY_S)
        except MarginGuardError as error:
            logging.error(f"SetupIKMoveIt: {error}")
            return False
        self._group = groupName
        return True

    def setupIKmoveit(self, groupName: str) -> bool:
        """Call `SetupIKMoveIt`, by its name in older versions."""
        return self.SetupIKMoveIt(groupName)

    def ComputeMoveItIK(
        self,
        targetPose: vtkMatrix4x4,
        tipLink: str = "",
        seedJointValues: Sequence[float] = (),
        timeout: float = 1.0,
        avoidCollisions: bool = False,
    ) -> tuple[float, ...]:
        """Values, in the order of `GetJoints`, that move a link to a pose in the root's frame.

        Empty, with a log line, if MoveIt finds none within ``timeout`` s. Without ``tipLink`` the
        link is the group's tip; without seed the search begins at the robot's present state.
        """
        try:
            if self._ik is None or not self._group:
                raise Ros2Error("no planning group is chosen; call SetupIKMoveIt first")
            request = self._request(targetPose, tipLink, seedJointValues, timeout)
            request["avoid_collisions"] = bool(avoidCollisions)
            reply = self._ik.call({"ik_request": request}, timeout + _TRANSPORT_S)
            return self._values_of(reply)
        except MarginGuardError as error:
            logging.error(f"ComputeMoveItIK: {error}")
            return ()

    def FindIKmoveit(
        self,
        targetPose: vtkMatrix4x4,
        tipLink: str = "",
        seedJointValues: Sequence[float] = (),
        timeout: float = 1.0,
    ) -> str:
        """Return `ComputeMoveItIK` like older versions: the values as text, separated by commas."""
        return joined(self.ComputeMoveItIK(targetPose, tipLink, seedJointValues, timeout))

    def close_moveit(self) -> None:
        """Leave the graph. Idempotent."""
        client, self._ik, self._group = self._ik, None, ""
        if client is not None and self._owner is not None:
            self._owner.ros.call(client.close)

    def _request(
        self, pose: vtkMatrix4x4, tip: str, seed: Sequence[float], timeout: float
    ) -> dict[str, Any]:
        """``moveit_msgs/PositionIKRequest`` as plain values, lengths in mm."""
        if self._robot is None or self._settings is None:
            raise Ros2Error("the robot has no description yet")
        if not 0.0 < timeout <= 1e6:
            raise Ros2Error(f"timeout is {timeout} s; expected more than 0, at most 1e6")
        position, orientation = translation_and_rotation(pose)
        start = self._positions(seed) if len(seed) else {}
        seconds, nanoseconds = divmod(round(timeout * NS_PER_S), NS_PER_S)
        return {
            "group_name": self._group,
            "ik_link_name": tip,
            "timeout": {"sec": seconds, "nanosec": nanoseconds},
            "robot_state": {
                "joint_state": {"name": list(start), "position": list(start.values())},
                "is_diff": True,
            },
            "pose_stamped": {
                "header": {"frame_id": self._settings.frame(self._robot.root_link)},
                "pose": {"position": position, "orientation": orientation},
            },
        }

    def _values_of(self, reply: Any) -> tuple[float, ...]:
        if reply.error_code.val != _SUCCESS:
            raise Ros2Error(f"MoveIt's error code is {reply.error_code.val}; expected {_SUCCESS}")
        state = reply.solution.joint_state
        found = dict(zip(state.name, state.position, strict=False))
        missing = [name for name in self.GetJoints() if name not in found]
        if missing:
            raise Ros2Error(f"MoveIt's solution has no joint {', '.join(missing)}")
        return tuple(float(found[name]) for name in self.GetJoints())
