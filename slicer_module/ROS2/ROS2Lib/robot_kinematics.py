"""Kinematics of a displayed robot, by the calls of SlicerROS2 that compute with KDL."""

import logging
from collections.abc import Mapping, Sequence

from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import MarginGuardError, Transform
from app.robot import Joint, Robot, UnreachableError
from app.scene.convert import vtk_matrix
from ROS2Lib.errors import Ros2Error
from ROS2Lib.vtk_values import transform


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
