"""Kinematics of a displayed robot, by the calls of SlicerROS2, and inverse kinematics by MoveIt."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any

from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.bridge.calls import ServiceClient
from app.bridge.robot_description import RobotSettings
from app.geometry import NS_PER_S, MarginGuardError, Transform
from app.robot import Joint, Robot, UnreachableError
from app.scene.convert import vtk_matrix
from ROS2Lib.member import Owner, Ros2Error
from ROS2Lib.vtk_values import transform, translation_and_rotation


class RobotKinematics:
    """The chain from the root link to the leaf with the most moving joints.

    Values of joints are in rad (m for sliding joints), poses in mm. The lists are empty before the
    description is received. Mimic joints are part of the chain's joints, as in KDL.
    """

    _robot: Robot | None = None

    def SetupKDLIKWithLimits(self) -> bool:
        """True if the description is there; the chain needs no preparation."""
        return self._robot is not None

    def FindRootAndTipLinks(self) -> tuple[str, ...]:
        """First and last link of the chain."""
        if self._robot is None:
            return ()
        chain = _longest_chain(self._robot)
        return (self._robot.root_link, chain[-1].child if chain else self._robot.root_link)

    def GetSegments(self) -> tuple[str, ...]:
        """Links of the chain after the root."""
        return tuple(joint.child for joint in self._chain())

    def GetJoints(self) -> tuple[str, ...]:
        """Moving joints of the chain, from the root to the tip."""
        return tuple(joint.name for joint in self._moving())

    def GetJointTypes(self) -> tuple[str, ...]:
        """``revolute``, ``continuous`` or ``prismatic``, in the order of `GetJoints`."""
        return tuple(str(joint.type) for joint in self._moving())

    def GetJointLowerPositionLimits(self) -> tuple[float, ...]:
        """Lower limits in the order of `GetJoints`; -inf for continuous joints."""
        return tuple(joint.lower for joint in self._moving())

    def GetJointUpperPositionLimits(self) -> tuple[float, ...]:
        """Upper limits in the order of `GetJoints`; inf for continuous joints."""
        return tuple(joint.upper for joint in self._moving())

    def GetJointVelocityLimits(self) -> tuple[float, ...]:
        """Largest velocities in rad/s (m/s) in the order of `GetJoints`; 0 where none is given."""
        return tuple(joint.dynamics.velocity or 0.0 for joint in self._moving())

    def ComputeKDLFK(
        self, jointValues: Sequence[float], outTransform: vtkMatrix4x4, linkName: str = ""
    ) -> vtkMatrix4x4 | None:
        """Write the pose of a link of the chain (by default the tip) in the root's frame.

        Returns ``outTransform``; on error logs it, returns None and leaves the matrix.
        """
        try:
            robot, poses = self._poses(jointValues)
            name = linkName or self.FindRootAndTipLinks()[1]
            if name not in (robot.root_link, *self.GetSegments()):
                raise Ros2Error(f"link {name!r} is not in the chain {self.GetSegments()}")
        except MarginGuardError as error:
            logging.error(f"ComputeKDLFK: {error}")
            return None
        outTransform.DeepCopy(vtk_matrix(poses[name]))
        return outTransform

    def ComputeLocalTransform(
        self, jointValues: Sequence[float], outTransform: vtkMatrix4x4, linkName: str
    ) -> vtkMatrix4x4 | None:
        """Write the pose of a link of the chain in its parent's frame, as `ComputeKDLFK`."""
        try:
            _, poses = self._poses(jointValues)
            joint = next((each for each in self._chain() if each.child == linkName), None)
            if joint is None:
                raise Ros2Error(f"link {linkName!r} is not in the chain {self.GetSegments()}")
        except MarginGuardError as error:
            logging.error(f"ComputeLocalTransform: {error}")
            return None
        parent_from_child = poses[joint.parent].inverse() @ poses[joint.child]
        outTransform.DeepCopy(vtk_matrix(parent_from_child))
        return outTransform

    def ComputeKDLIK(
        self, targetPose: vtkMatrix4x4, seedJointValues: Sequence[float] = ()
    ) -> tuple[float, ...]:
        """Joint values within the limits that move the tip to a pose in the root's frame.

        Empty, with a log line, if there are none. The search begins at ``seedJointValues``.
        """
        try:
            if self._robot is None:
                raise Ros2Error("the robot has no description yet")
            _, tip = self.FindRootAndTipLinks()
            goal = transform(targetPose, self._robot.root_link, tip)
            moving = [joint for joint in self._moving() if joint.mimic is None]
            seed = self._positions(seedJointValues) if len(seedJointValues) else {}
            own = {joint.name: seed[joint.name] for joint in moving if joint.name in seed}
            found = self._robot.inverse_kinematics(tip, goal, seed=own)
        except UnreachableError as error:
            logging.warning(f"ComputeKDLIK: {error}")
            return ()
        except MarginGuardError as error:
            logging.error(f"ComputeKDLIK: {error}")
            return ()
        return tuple(self._value(joint, found) for joint in self._moving())

    def FindKDLIK(self, targetPose: vtkMatrix4x4, seedJointValues: Sequence[float] = ()) -> str:
        """Return `ComputeKDLIK` like older versions: the values as text, separated by commas."""
        return joined(self.ComputeKDLIK(targetPose, seedJointValues))

    def _value(self, joint: Joint, found: dict[str, float]) -> float:
        if joint.mimic is None:
            return found[joint.name]
        leader = next(each for each in self._joints() if each.name == joint.mimic.leader)
        return joint.mimic.multiplier * self._value(leader, found) + joint.mimic.offset

    def _joints(self) -> tuple[Joint, ...]:
        return () if self._robot is None else self._robot.joints

    def _chain(self) -> list[Joint]:
        return [] if self._robot is None else _longest_chain(self._robot)

    def _moving(self) -> list[Joint]:
        return [joint for joint in self._chain() if joint.moves]

    def _positions(self, values: Sequence[float]) -> dict[str, float]:
        moving = self._moving()
        if len(values) != len(moving):
            raise Ros2Error(f"there are {len(values)} joint values; expected {len(moving)}")
        return {joint.name: float(value) for joint, value in zip(moving, values, strict=True)}

    def _poses(self, values: Sequence[float]) -> tuple[Robot, Mapping[str, Transform]]:
        if self._robot is None:
            raise Ros2Error("the robot has no description yet")
        return self._robot, self._robot.forward_kinematics(self._positions(values))


def joined(values: Sequence[float]) -> str:
    """Joint values as text, separated by commas; empty without values."""
    return ",".join(map(str, values))


def _longest_chain(robot: Robot) -> list[Joint]:
    """Joints from the root to the leaf with the most moving joints, then with the most links."""
    parents = {joint.child: joint for joint in robot.joints}
    leaves = {link.name for link in robot.links} - {joint.parent for joint in robot.joints}

    def chain(link: str) -> list[Joint]:
        found: list[Joint] = []
        while link in parents:
            found.append(parents[link])
            link = parents[link].parent
        return found[::-1]

    chains = [chain(link.name) for link in robot.links if link.name in leaves]
    return max(chains, key=lambda each: (sum(joint.moves for joint in each), len(each)))


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
