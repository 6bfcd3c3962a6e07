"""Links of a displayed robot that follow joint states: one transform and one model per link."""

from typing import Any

import numpy as np
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from slicer import vtkMRMLLinearTransformNode

from app.bridge.robot_description import RobotSettings
from app.bridge.robots import MAX_JOINT_STATE_BYTES, JointFollower
from app.bridge.topics import Topic
from app.geometry import NS_PER_S, Transform
from app.robot import Robot
from app.scene import RobotModel, SceneError
from app.scene.convert import vtk_matrix
from app.scene.scene_nodes import NodeIntegrity
from ROS2Lib.member import Owner


class JointLinks:
    """Computes the poses from the positions on ``topic``; the interface is that of `TfLinks`.

    A fixed frame other than the root link is looked up in tf.
    """

    def __init__(
        self, scene: Any, owner: Owner, settings: RobotSettings, robot: Robot, topic: str
    ) -> None:
        self._scene = scene
        self._owner = owner
        self._robot = robot
        self._problem = "no joint state yet"
        buffer = owner.buffer if settings.fixed_frame else None
        self._follower = JointFollower(robot, settings, buffer)
        self._last_ns: int | None = None
        self._base = vtkMRMLLinearTransformNode()
        self._base.SetName(f"ros2:joints:{settings.name}")
        scene.AddNode(self._base)
        self._model = RobotModel(scene, robot, self._base, robot.root_link)
        self._integrity = NodeIntegrity()
        moving = [node for node in self._model.transforms.values() if node is not self._base]
        self._integrity.record((*moving, *self.models))
        self._subscription: Any = owner.ros.subscribe(
            Topic(settings.topic(topic), JointState, qos_profile_sensor_data), self._take, raw=True
        )

    @property
    def nodes(self) -> dict[str, vtkMRMLLinearTransformNode]:
        """Transform of each link: the root's in the fixed frame, the others' in the root's."""
        return dict(self._model.transforms)

    @property
    def models(self) -> list[Any]:
        """The models of the links."""
        return list(self._model.models.values())

    def is_whole(self) -> bool:
        """False if a node was removed or hardened. Restores the parents of moved links."""
        try:
            self._integrity.restore((*self._model.transforms.values(), *self.models))
        except SceneError:
            return False
        return True

    def problem(self) -> str:
        """The reason why the poses are not valid; empty if they are."""
        return self._problem

    def spin(self) -> bool:
        """Move the links to their newest poses; True if these are not valid."""
        state = self._follower.state(self._owner.now_ns())
        self._problem = state.problems[0] if state.is_stale and state.problems else ""
        if state.poses is not None and state.stamp_ns != self._last_ns:
            self._last_ns = state.stamp_ns
            root = self._robot.root_link
            base = Transform.from_matrix(
                state.poses[state.links.index(root)], target="fixed", source=root
            )
            self._base.SetMatrixTransformToParent(vtk_matrix(base))
            root_from_fixed = np.linalg.inv(base.matrix)
            self._model.set_links(
                {
                    link: Transform.from_matrix(root_from_fixed @ pose, target=root, source=link)
                    for link, pose in zip(state.links, state.poses, strict=True)
                    if link != root
                }
            )
        return state.is_stale

    def set_known(self, known: bool) -> None:
        """Show the links in their colours, or in grey."""
        self._model.set_known(known)

    def remove(self) -> None:
        """Stop following, and remove models and transforms. Idempotent."""
        subscription, self._subscription = self._subscription, None
        if subscription is None:
            return
        ros = self._owner.ros
        ros.call(lambda: ros.destroy_subscription(subscription))
        self._model.remove()
        self._scene.RemoveNode(self._base)

    def _take(self, raw: bytes) -> None:
        """Take one message. Runs in the node's thread."""
        if len(raw) <= MAX_JOINT_STATE_BYTES:
            message: JointState = deserialize_message(raw, JointState)
            stamp = message.header.stamp
            stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
            self._follower.take(message.name, message.position, stamp_ns)
            self._owner.wake()
