"""Links of a displayed robot that follow tf: one lookup and one model per link."""

from typing import Any

from app.bridge.robot_description import RobotSettings
from app.robot import Robot
from app.scene import RobotModel, SceneError
from app.scene.convert import vtk_matrix
from app.scene.scene_nodes import NodeIntegrity
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Owner
from ROS2Lib.tf2_lookup import MISSING, vtkMRMLROS2Tf2LookupNode

ROBOT_ATTRIBUTE = "ros2.robot"
"""Attribute of the lookups that a robot has created: the robot's name."""


class TfLinks:
    """Made for one ``robot``; `remove` removes what it has made. Raises `Ros2Error`."""

    def __init__(self, scene: Any, owner: Owner, settings: RobotSettings, robot: Robot) -> None:
        self.nodes: dict[str, vtkMRMLROS2Tf2LookupNode] = {}
        self._owner = owner
        self._name = settings.name
        self._own: list[tuple[str, str]] = []
        self._integrity = NodeIntegrity()
        self._model: RobotModel | None = None
        try:
            self._build(scene, settings, robot)
        except Exception:
            self.remove()  # no partial robot may be shown
            raise

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

    def set_known(self, known: bool) -> None:
        """Show the links in their colours, or in grey."""
        if self._model is not None:
            self._model.set_known(known)

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
