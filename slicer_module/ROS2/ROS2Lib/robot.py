"""Robots described by a parameter and posed by tf: one lookup and one model per link."""

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.robots import DescriptionListener, DescriptionSource, RobotSettings
from app.robot import Robot
from app.runtime.latest_value import LatestValue
from app.scene import RobotModel, SceneError
from app.scene.nodes.convert import vtk_matrix
from app.scene.nodes.node_integrity import NodeIntegrity
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner
from ROS2Lib.tf2_lookup import MISSING, vtkMRMLROS2Tf2LookupNode


class vtkMRMLROS2RobotNode(Member, vtkMRMLScriptedModuleNode):
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

    def AddToROS2Node(  # type: ignore[override]  # SlicerROS2's order of names
        self,
        nodeId: str,
        parameterNodeName: str,
        parameterName: str = "robot_description",
        robotName: str = "",
        fixedFrame: str = "",
        tfPrefix: str = "",
    ) -> bool:
        """Add it to a ROS node; on error log it, return False.

        ``robotName``: by default that of `SetRobotName`, or ``robot``.
        """
        name = robotName or self._name or "robot"
        return self.add_to(nodeId, (name, parameterNodeName, parameterName, fixedFrame, tfPrefix))

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
        robot = self._described.take(0.0) or (None if self._is_whole() else self._robot)
        if robot is not None:
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
        source = DescriptionSource(f"/{node.strip('/')}", parameter, topic="")
        self._description = DescriptionListener(
            owner.ros, self._settings, source, self._described.put
        )
        self.SetName(f"ros2:robot:{name}")
        self.SetModuleName("ROS2")

    def _stop(self) -> None:
        if self._description is not None:
            self._description.close()
            self._description = None
        self._clear()

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
            return there
        made = self._owner.create(vtkMRMLROS2Tf2LookupNode, parent, child)
        if made is None:
            raise Ros2Error(f"{self.GetName()}: no lookup from {parent!r} to {child!r}")
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
