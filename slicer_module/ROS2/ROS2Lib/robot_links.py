"""Links of a displayed robot, by tf or joint states, and their translucent copy at a goal pose."""

import logging
from typing import Any

import numpy as np
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelDisplayNode, vtkMRMLModelNode
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.bridge.robot_description import RobotSettings, absolute
from app.bridge.robots import JointFollower
from app.bridge.topics import Topic
from app.geometry import Transform
from app.robot import Robot
from app.scene import RobotModel, SceneError
from app.scene.convert import vtk_matrix
from app.scene.scene_nodes import NodeIntegrity
from ROS2Lib.member import Owner, Ros2Error, references
from ROS2Lib.tf2_nodes import MISSING, vtkMRMLROS2Tf2LookupNode

ROBOT_ATTRIBUTE = "ros2.robot"
"""Attribute of the lookups that a robot has created: the robot's name."""


class _Links:
    """Base: the models of the links, below the ``nodes`` that move them."""

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}
        """Transform of each link, the root's first."""
        self._integrity = NodeIntegrity()
        self._model: RobotModel | None = None

    @property
    def models(self) -> list[Any]:
        """The models of the links."""
        return [] if self._model is None else list(self._model.models.values())

    def is_whole(self) -> bool:
        """False if a node was removed or hardened. Restores the parents of moved links.

        The root's parent is free.
        """
        try:
            self._integrity.restore((*self.nodes.values(), *self.models))
        except SceneError:
            return False
        return True

    def set_known(self, known: bool) -> None:
        """Show the links in their colours, or in grey."""
        if self._model is not None:
            self._model.set_known(known)


class TfLinks(_Links):
    """Links of one ``robot`` that follow tf: one lookup and one model per link.

    `remove` removes what it has made. Raises `Ros2Error`.
    """

    def __init__(self, scene: Any, owner: Owner, settings: RobotSettings, robot: Robot) -> None:
        super().__init__()
        self._owner = owner
        self._name = settings.name
        self._own: list[tuple[str, str]] = []
        try:
            self._build(scene, settings, robot)
        except Exception:
            self.remove()  # no partial robot may be shown
            raise

    def problem(self) -> str:
        """The reason why the poses are not valid; empty if they are."""
        stale = (
            f"link {link!r} is {node.GetState()} {node.GetProblem()}".strip()
            for link, node in self.nodes.items()
            if node.IsStale()
        )
        return next(stale, "")

    def spin(self) -> bool:
        """True if a pose is not valid. The ROS node spins the lookups, which are its members."""
        return any(node.IsStale() for node in self.nodes.values())

    def remove(self) -> None:
        """Remove models and lookups. Idempotent."""
        if self._model is not None:
            self._model.remove()
            self._model = None
        for parent, child in self._own:
            lookup = self._owner.find(vtkMRMLROS2Tf2LookupNode, parent, child)
            if lookup is not None:
                self._owner.remove(lookup, lookup.GetName())
        self._own.clear()
        self.nodes.clear()
        self._integrity.record(())

    def _build(self, scene: Any, settings: RobotSettings, robot: Robot) -> None:
        root = robot.root_link
        self.nodes[root] = self._lookup(settings.root_frame(robot), settings.frame(root))
        for joint in robot.joints:
            node = self._lookup(settings.frame(joint.parent), settings.frame(joint.child))
            if node.GetState() == MISSING:
                node.SetMatrixTransformToParent(vtk_matrix(joint.origin))
            self.nodes[joint.child] = node
        for joint in robot.joints:
            parent = self.nodes[joint.parent]
            self.nodes[joint.child].SetAndObserveTransformNodeID(parent.GetID())
        self._model = RobotModel(scene, robot, self.nodes[root], root)
        for link, model in self._model.models.items():
            model.SetAndObserveTransformNodeID(self.nodes[link].GetID())
        # The lookups replace the model's own transforms.
        for link in [link for link in self._model.transforms if link != root]:
            scene.RemoveNode(self._model.transforms.pop(link))
        for node in self.nodes.values():
            node.spin()
        kept = [node for link, node in self.nodes.items() if link != root]
        self._integrity.record((*kept, *self.models))

    def _lookup(self, parent: str, child: str) -> vtkMRMLROS2Tf2LookupNode:
        """Lookup node of the edge; an existing one stays owned by its creator."""
        there = self._owner.find(vtkMRMLROS2Tf2LookupNode, parent, child)
        if there is not None:
            if there.GetAttribute(ROBOT_ATTRIBUTE) == self._name:  # of a loaded scene
                self._own.append((parent, child))
            return there
        # As in SlicerROS2 the root's lookup alone invokes events without a new sample.
        is_root = not self.nodes
        made = self._owner.create(
            vtkMRMLROS2Tf2LookupNode,
            parent,
            child,
            prepare=lambda node: node.SetModifiedOnLookup(is_root),
        )
        if made is None:
            raise Ros2Error(f"robot {self._name!r}: no lookup from {parent!r} to {child!r}")
        made.SetAttribute(ROBOT_ATTRIBUTE, self._name)
        self._own.append((parent, child))
        return made


class JointLinks(_Links):
    """Links that follow the joint states on ``topic``: one transform and one model per link.

    The interface is that of `TfLinks`: nodes are the root's transform in the fixed frame, and the
    others' in the root's. A fixed frame other than the root link is looked up in tf.
    """

    def __init__(
        self, scene: Any, owner: Owner, settings: RobotSettings, robot: Robot, topic: str
    ) -> None:
        super().__init__()
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
        self._model = self._links = RobotModel(scene, robot, self._base, robot.root_link)
        self.nodes = self._links.transforms
        moving = [node for node in self.nodes.values() if node is not self._base]
        self._integrity.record((*moving, *self.models))
        self._subscription: Any = owner.ros.subscribe(
            Topic(absolute(topic), JointState, qos_profile_sensor_data), self._take, raw=True
        )

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
            self._links.set_links(
                {
                    link: Transform.from_matrix(root_from_fixed @ pose, target=root, source=link)
                    for link, pose in zip(state.links, state.poses, strict=True)
                    if link != root
                }
            )
        return state.is_stale

    def remove(self) -> None:
        """Stop following, and remove models and transforms. Idempotent."""
        subscription, self._subscription = self._subscription, None
        if subscription is None:
            return
        ros = self._owner.ros
        ros.call(lambda: ros.destroy_subscription(subscription))
        self._links.remove()
        self._scene.RemoveNode(self._base)

    def _take(self, raw: bytes) -> None:
        """Take one message. Runs in the node's thread."""
        self._follower.receive(raw)
        self._owner.wake()


COLOUR = (0.0, 1.0, 1.0)
OPACITY = 0.3
MODEL_ROLE, TRANSFORM_ROLE = "goal_model", "goal_transform"


def create_goal(robot: Any, source: Any) -> bool:
    """Copy the links of ``source`` at their present poses; False, with a log line, without links.

    The copies are references of ``robot``, of roles ``goal_model`` and ``goal_transform``. They
    stay where they are until a script moves the transforms. If there are some, nothing is done.
    """
    scene = robot.GetScene()
    if scene is None or source is None or source.GetScene() is None:
        logging.error("CreateGoalStateRobot: both robots must be in a scene")
        return False
    if robot.GetNumberOfNodeReferences(MODEL_ROLE):
        return True
    nodes = source.link_nodes()
    if not nodes:
        logging.error(f"CreateGoalStateRobot: {source.GetName()} has no links yet")
        return False
    transforms = {}
    for link, node in nodes.items():
        made = vtkMRMLLinearTransformNode()
        made.SetName(f"{link}_goal_transform")
        scene.AddNode(made)
        matrix = vtkMatrix4x4()
        node.GetMatrixTransformToParent(matrix)
        made.SetMatrixTransformToParent(matrix)
        transforms[node.GetID()] = made
        robot.AddNodeReferenceID(TRANSFORM_ROLE, made.GetID())
    for node in nodes.values():
        parent = transforms.get(node.GetTransformNodeID() or "")
        if parent is not None:
            transforms[node.GetID()].SetAndObserveTransformNodeID(parent.GetID())
    for model in references(source, "model"):
        _copy_model(robot, model, transforms[model.GetTransformNodeID()])
    return True


def remove_goal(robot: Any) -> bool:
    """Remove the copies that `create_goal` has made; False if the robot is in no scene."""
    scene = robot.GetScene()
    if scene is None:
        logging.error("RemoveGoalStateRobot: the robot must be in a scene")
        return False
    for model in references(robot, MODEL_ROLE):
        scene.RemoveNode(model.GetDisplayNode())
        scene.RemoveNode(model)
    for transform in references(robot, TRANSFORM_ROLE):
        scene.RemoveNode(transform)
    robot.RemoveNodeReferenceIDs(MODEL_ROLE)
    robot.RemoveNodeReferenceIDs(TRANSFORM_ROLE)
    return True


def _copy_model(robot: Any, model: Any, transform: Any) -> None:
    scene = robot.GetScene()
    display = vtkMRMLModelDisplayNode()
    display.SetColor(*COLOUR)
    display.SetOpacity(OPACITY)
    scene.AddNode(display)
    made = vtkMRMLModelNode()
    made.SetName(f"{model.GetName()}_goal")
    made.SetAndObservePolyData(model.GetPolyData())
    scene.AddNode(made)
    made.SetAndObserveDisplayNodeID(display.GetID())
    made.SetAndObserveTransformNodeID(transform.GetID())
    robot.AddNodeReferenceID(MODEL_ROLE, made.GetID())
