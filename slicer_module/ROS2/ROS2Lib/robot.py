"""Robots described by a parameter and posed by tf: one lookup and one model per link."""

import logging

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.robots import DescriptionListener, DescriptionSource, RobotSettings
from app.robot import Robot
from app.runtime.latest_value import LatestValue
from app.scene import RobotModel, SceneError
from app.scene.nodes.convert import vtk_matrix
from app.scene.nodes.node_integrity import NodeIntegrity
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner
from ROS2Lib.parameter import vtkMRMLROS2ParameterNode
from ROS2Lib.robot_goal import create_goal, remove_goal
from ROS2Lib.robot_kinematics import RobotKinematics
from ROS2Lib.tf2_lookup import MISSING, vtkMRMLROS2Tf2LookupNode

_ORDER = ("robot", "node", "parameter", "frame", "prefix")
_OLD_ORDER = ("node", "parameter", "robot", "frame", "prefix")
ROBOT_ATTRIBUTE = "ros2.robot"
"""Attribute of the lookups that a robot has created: the robot's name."""


class vtkMRMLROS2RobotNode(RobotKinematics, Member, vtkMRMLScriptedModuleNode):
    """One model ``<link>_model`` per link, below its lookup ``ros2:tf2lookup:<parent>To<child>``.

    Links stand at their zero pose until tf provides one, and all are grey while any lookup is not
    ``valid``: a coloured robot is at its measured pose. The robot is rebuilt when the description
    changes. ``ModifiedEvent`` is invoked after a build and when the robot turns grey or coloured.
    """

    ROLE = "robot"

    def __init__(self) -> None:
        self._settings: RobotSettings | None = None
        self._name = ""
        self._description: DescriptionListener | None = None
        self._described: LatestValue[Robot] = LatestValue()
        self._robot: Robot | None = None
        self._model: RobotModel | None = None
        self._lookups: dict[str, vtkMRMLROS2Tf2LookupNode] = {}
        self._own: list[tuple[str, str]] = []
        self._integrity = NodeIntegrity()
        self._is_stale = True
        self._is_removed = False

    def GetRobotName(self) -> str:
        """The robot's name."""
        return self._name if self._settings is None else self._settings.name

    def SetRobotName(self, robotName: str) -> None:
        """Set the name with which `AddToROS2Node` adds the robot."""
        if self.IsAddedToROS2Node():
            raise Ros2Error(
                f"{self.GetName()}: the name must be set before it is added to a ROS node"
            )
        self._name = robotName
        self.SetName(f"ros2:robot:{robotName}")

    def AddToROS2Node(self, nodeId: str, *names: str) -> bool:
        """Add it to a ROS node; on error log it, return False.

        ``names``: robot, parameter node, parameter (``robot_description``), fixed frame, tf
        prefix; the last three may be left out. As in older versions of SlicerROS2, a first name
        that begins with ``/`` or stands alone is the parameter node; then follow parameter, robot
        (by default that of `SetRobotName`, or ``robot``), fixed frame and prefix.
        """
        if not 1 <= len(names) <= len(_OLD_ORDER):
            logging.error(f"{self.GetName()}: {len(names)} names; expected 1 to {len(_OLD_ORDER)}")
            return False
        order = _OLD_ORDER if len(names) == 1 or names[0].startswith("/") else _ORDER
        given = dict(zip(order, names, strict=False))
        name = given.get("robot") or self._name or "robot"
        parameter = given.get("parameter", "robot_description")
        rest = (given.get("frame", ""), given.get("prefix", ""))
        return self.add_to(nodeId, (name, given["node"], parameter, *rest))

    def SetRobotDescriptionParameterNode(
        self, node: vtkMRMLROS2ParameterNode | None = None
    ) -> bool:
        """Refer to the node that monitors the description, role ``parameter``; False on error.

        Without ``node`` it is the ROS node's parameter node, which is created if it has none. The
        description itself is received by the robot.
        """
        if self._owner is None or self._settings is None:
            logging.error(f"{self.GetName()} is not on a ROS node; add it first")
            return False
        if node is None:
            _, monitored, parameter, *_ = self._names
            found = self._owner.find(vtkMRMLROS2ParameterNode, monitored)
            node = found or self._owner.create(vtkMRMLROS2ParameterNode, monitored)
            if node is None:
                return False
            if parameter not in node.GetMonitoredParameters():
                node.AddParameter(parameter)
        self.SetNodeReferenceID("parameter", node.GetID())
        return True

    def ObserveParameterNode(self, node: vtkMRMLROS2ParameterNode) -> None:
        """As `SetRobotDescriptionParameterNode`."""
        self.SetRobotDescriptionParameterNode(node)

    def ParseRobotDescription(self) -> bool:
        """True if a description was received and is valid."""
        return self._robot is not None

    def SetupRobotVisualization(self) -> None:
        """Build the robot again from its last description."""
        if self._robot is not None:
            self._is_removed = False
            self._described.put(self._robot)
            self.spin()

    def RemoveRobotVisualization(self) -> None:
        """Remove models and lookups until `SetupRobotVisualization` or a new description."""
        self._is_removed = True
        self._clear()

    def CreateGoalStateRobot(self, sourceRobot: "vtkMRMLROS2RobotNode") -> bool:
        """Show a translucent copy of ``sourceRobot``, whose transforms a script may move."""
        return create_goal(self, sourceRobot)

    def RemoveGoalStateRobot(self) -> bool:
        """Remove the copy."""
        return remove_goal(self)

    def GetLinkNames(self) -> tuple[str, ...]:
        """Names of the links, the root first; empty before the description is received."""
        return tuple(self._lookups)

    def IsStale(self) -> bool:
        """True before the robot is built, and while any link has no valid pose."""
        return self._is_stale

    def GetProblem(self) -> str:
        """Problem of the description or the poses; empty if there is none."""
        if not self._lookups:
            return "" if self._description is None else self._description.problem
        stale = (
            f"link {link!r} is {node.GetState()} {node.GetProblem()}".strip()
            for link, node in self._lookups.items()
            if node.IsStale()
        )
        return next(stale, "")

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The robot's name."""
        return (names[0],)

    def status(self) -> str:
        """The problem, or the number of links."""
        return self.GetProblem() or f"{len(self._lookups)} links"

    def spin(self) -> None:
        """Build the robot for a new description and update its colour.

        Rebuilds it also when a link was removed from the scene or its surface changed. Restores
        the parent of a link that was moved in the hierarchy; the root's parent is free.
        """
        described = self._described.take(0.0)
        is_lost = not (self._is_removed or self._is_whole())
        robot = described or (self._robot if is_lost else None)
        if robot is not None:
            self._is_removed = False
            self._clear()
            self._robot = None
            try:
                self._build(robot)
            except Exception:
                self._clear()  # no partial robot may be shown
                raise
            self._robot = robot
        if self._model is None:
            return
        is_stale = any(node.IsStale() for node in self._lookups.values())
        if is_stale != self._is_stale or robot is not None:
            self._is_stale = is_stale
            self._model.set_known(not is_stale)
            self.Modified()

    def _start(
        self,
        owner: Owner,
        name: str,
        node: str,
        parameter: str,
        fixed_frame: str,
        tf_prefix: str,
    ) -> None:
        if not node.strip("/"):
            raise Ros2Error(f"robot {name!r}: parameter node name is empty; expected a node name")
        self._settings = RobotSettings(name, tf_prefix=tf_prefix, fixed_frame=fixed_frame)
        self._is_removed = False
        source = DescriptionSource(f"/{node.strip('/')}", parameter, topic="")

        def described(robot: Robot) -> None:
            self._described.put(robot)
            owner.wake()

        self._description = DescriptionListener(owner.ros, self._settings, source, described)
        self.SetName(f"ros2:robot:{name}")

    def _stop(self) -> None:
        if self._description is not None:
            self._description.close()
            self._description = None
        self.RemoveGoalStateRobot()
        self._clear()
        self._robot = None

    def _build(self, robot: Robot) -> None:
        owner, settings = self._owner, self._settings
        if owner is None or settings is None:
            return
        root = robot.root_link
        self._lookups[root] = self._lookup(settings.root_frame(robot), settings.frame(root))
        for joint in robot.joints:
            node = self._lookup(settings.frame(joint.parent), settings.frame(joint.child))
            if node.GetState() == MISSING:
                node.SetMatrixTransformToParent(vtk_matrix(joint.origin))
            self._lookups[joint.child] = node
        for joint in robot.joints:
            parent = self._lookups[joint.parent]
            self._lookups[joint.child].SetAndObserveTransformNodeID(parent.GetID())
        self._model = RobotModel(self.GetScene(), robot, self._lookups[root], root)
        for link, model in self._model.models.items():
            model.SetAndObserveTransformNodeID(self._lookups[link].GetID())
        # The lookups replace the model's own transforms.
        for link in [link for link in self._model.transforms if link != root]:
            self.GetScene().RemoveNode(self._model.transforms.pop(link))
        for node in self._lookups.values():
            node.spin()
            self.AddNodeReferenceID("lookup", node.GetID())
        for model in self._model.models.values():
            self.AddNodeReferenceID("model", model.GetID())
        kept = [node for link, node in self._lookups.items() if link != root]
        self._integrity.record((*kept, *self._model.models.values()))

    def _is_whole(self) -> bool:
        models = () if self._model is None else self._model.models.values()
        try:
            self._integrity.restore((*self._lookups.values(), *models))
        except SceneError:
            return False
        return True

    def _lookup(self, parent: str, child: str) -> vtkMRMLROS2Tf2LookupNode:
        """Lookup node of the edge; an existing one stays owned by its creator."""
        if self._owner is None:
            raise Ros2Error(f"{self.GetName()} is not on a ROS node")
        there = self._owner.find(vtkMRMLROS2Tf2LookupNode, parent, child)
        if there is not None:
            if there.GetAttribute(ROBOT_ATTRIBUTE) == self.GetRobotName():  # of a loaded scene
                self._own.append((parent, child))
            return there
        # As in SlicerROS2 the root's lookup alone invokes events without a new sample.
        is_root = not self._lookups
        made = self._owner.create(
            vtkMRMLROS2Tf2LookupNode,
            parent,
            child,
            prepare=lambda node: node.SetModifiedOnLookup(is_root),
        )
        if made is None:
            raise Ros2Error(f"{self.GetName()}: no lookup from {parent!r} to {child!r}")
        made.SetAttribute(ROBOT_ATTRIBUTE, self.GetRobotName())
        self._own.append((parent, child))
        return made

    def _clear(self) -> None:
        if self._model is not None:
            self._model.remove()
            self._model = None
        if self._owner is not None:
            for parent, child in self._own:
                lookup = self._owner.find(vtkMRMLROS2Tf2LookupNode, parent, child)
                if lookup is not None:
                    self._owner.remove(lookup, lookup.GetName())
        self._own.clear()
        self._lookups.clear()
        self._integrity.record(())
        self._is_stale = True
        self.RemoveNodeReferenceIDs("lookup")
        self.RemoveNodeReferenceIDs("model")
