"""Logic of the module for scripts: ROS node, robots, spinning; and tables and form of its panel."""

import time
from collections.abc import Callable, Iterator
from typing import Any

from slicer import vtkMRMLScene

from app.geometry import MarginGuardError
from ROS2Lib.class_names import ScenePatch, node_class
from ROS2Lib.node import vtkMRMLROS2NodeNode
from ROS2Lib.robot import DEFAULTS, FILE, MESH_MAP, PARAMETER, TOPIC, vtkMRMLROS2RobotNode
from ROS2Lib.scene_loader import SceneLoader
from ROS2Lib.service_nodes import vtkMRMLROS2ServiceClientNode
from ROS2Lib.topic_nodes import vtkMRMLROS2PublisherNode, vtkMRMLROS2SubscriberNode

DEFAULT_NODE = "slicer"
_POLL_S = 0.02


class Ros2Api:
    """Logic of the module for one ``scene``.

    Until `Close` the scene also makes and finds nodes by the class names of SlicerROS2
    (`ScenePatch`), and nodes of a scene that is loaded join the ROS graph (`SceneLoader`).

    ``received()`` is called in any thread when data wait for `Spin`, once `Spin` has been called
    after the creation of the ROS node that has received them.
    """

    def __init__(self, scene: vtkMRMLScene, received: Callable[[], None] | None = None) -> None:
        self.scene = scene
        self._patch = ScenePatch(scene)
        self._loader = SceneLoader(scene, self.GetDefaultROS2Node)
        self._received = received

    def GetDefaultROS2Node(self) -> vtkMRMLROS2NodeNode:
        """The ROS node ``slicer``, created on first use.

        Raises `MarginGuardError` if it cannot be created; the scene then stays unchanged.
        """
        for node in self.nodes():
            if node.GetROS2NodeName() == DEFAULT_NODE and node.IsCreated():
                return node
        made = vtkMRMLROS2NodeNode()
        made.SaveWithSceneOff()  # it is made when the module starts
        self.scene.AddNode(made)
        try:
            made.Create(DEFAULT_NODE)
        except MarginGuardError:
            self.scene.RemoveNode(made)
            raise
        return made

    def AddNewNodeByClass(self, className: str, name: str = "") -> Any:
        """Add a new node like the scene, for classes of this module that the scene cannot make."""
        node = node_class(className)()
        if name:
            node.SetName(name)
        self.scene.AddNode(node)
        return node

    def Spin(self) -> None:
        """Bring what has come into the scene, for every ROS node in it; often, in its thread."""
        for node in self.nodes():
            if self._received is not None:
                node.call_when_received(self._received)
            node.Spin()

    def AddRobot(
        self,
        robotName: str,
        parameterNodeName: str,
        parameterName: str = "robot_description",
        fixedFrame: str = "",
        tfPrefix: str = "",
        source: str = PARAMETER,
        jointStates: str = "",
    ) -> vtkMRMLROS2RobotNode | None:
        """Add a robot to the default node; see `vtkMRMLROS2NodeNode.CreateAndAddRobotNode`."""
        return self.GetDefaultROS2Node().CreateAndAddRobotNode(
            robotName, parameterNodeName, parameterName, fixedFrame, tfPrefix, source, jointStates
        )

    def RemoveRobot(self, robotName: str) -> bool:
        """Remove a robot of the default node; False if there is none."""
        return self.GetDefaultROS2Node().RemoveAndDeleteRobotNode(robotName)

    def WaitForServiceResponse(
        self, client: vtkMRMLROS2ServiceClientNode, timeoutSec: float
    ) -> bool:
        """Spin until the last request ends, at most ``timeoutSec``; True if it was answered."""
        until = time.monotonic() + timeoutSec
        while client.IsRequestInProgress() and time.monotonic() < until:
            client.wait(min(_POLL_S, max(0.0, until - time.monotonic())))
            self.Spin()
            client.spin()  # `Spin` skips this client if its own observer waits
        return client.GetLastResponseStatus()

    def Destroy(self) -> None:
        """Remove all ROS nodes from the scene. Idempotent."""
        for node in tuple(self.nodes()):
            node.Destroy()

    def Close(self) -> None:
        """`Destroy`, and undo the changes to the scene object. Idempotent."""
        self.Destroy()
        self._patch.remove()
        self._loader.close()

    def listing(self) -> str:
        """ROS nodes and members with their status, one per line."""
        lines = []
        for node in self.nodes():
            lines.append(node.GetName())
            lines += [f"    {each.GetName()}: {each.status()}" for each in node.members]
        return "\n".join(lines)

    def nodes(self) -> Iterator[vtkMRMLROS2NodeNode]:
        """The ROS nodes in the scene."""
        # Not `GetNodesByClass`: the collection that it returns is never freed.
        # The methods of the class: those of the object are `ScenePatch`'s.
        name = "vtkMRMLScriptedModuleNode"
        count = vtkMRMLScene.GetNumberOfNodesByClass(self.scene, name)
        each = [vtkMRMLScene.GetNthNodeByClass(self.scene, n, name) for n in range(count)]
        return (node for node in each if isinstance(node, vtkMRMLROS2NodeNode))


Rows = list[tuple[str, ...]]


class MemberTables:
    """Fills the tables of ``ui`` when their text has changed.

    ``make_item(text)`` makes a cell. ``choose(name)`` is called when a robot is clicked.
    """

    def __init__(
        self, ui: Any, make_item: Callable[[str], Any], choose: Callable[[str], None]
    ) -> None:
        self._make_item = make_item
        self._choose = choose
        self._shown: dict[str, Rows] = {}
        self._tables = {
            "robots": ui.robotsTableWidget,
            "subscribers": ui.subscribersTableWidget,
            "publishers": ui.publishersTableWidget,
        }
        ui.robotsTableWidget.cellClicked.connect(self._on_robot)

    def update(self, logic: Ros2Api) -> None:
        """Show the members as they are now."""
        for name, rows in table_rows(logic).items():
            if self._shown.get(name) != rows:
                self._shown[name] = rows
                self._fill(self._tables[name], rows)

    def _fill(self, table: Any, rows: Rows) -> None:
        table.setRowCount(len(rows))
        for row, texts in enumerate(rows):
            for column, text in enumerate(texts):
                table.setItem(row, column, self._make_item(text))
        table.resizeColumnsToContents()

    def _on_robot(self, row: int, _: int) -> None:
        rows = self._shown.get("robots", [])
        if row < len(rows):
            self._choose(rows[row][0])


def table_rows(logic: Ros2Api) -> dict[str, Rows]:
    """Texts of the rows by table, in the order of the members."""
    robots: Rows = []
    subscribers: Rows = []
    publishers: Rows = []
    for node in logic.nodes():
        for each in node.members:
            if isinstance(each, vtkMRMLROS2RobotNode):
                links = str(len(each.GetLinkNames()))
                robots.append(
                    (each.GetRobotName(), node.GetROS2NodeName(), links, each.GetProblem())
                )
            elif isinstance(each, vtkMRMLROS2SubscriberNode):
                count = str(each.GetNumberOfMessages())
                subscribers.append((each.GetTopic(), each.GetROSType(), count))
            elif isinstance(each, vtkMRMLROS2PublisherNode):
                count = str(each.GetNumberOfMessagesSent())
                publishers.append((each.GetTopic(), each.GetROSType(), count))
    return {"robots": robots, "subscribers": subscribers, "publishers": publishers}


_JOINT_STATES = "joint states"


class RobotForm:
    """Reads the fields of ``ui``, and shows which of them belong to the chosen source."""

    def __init__(self, ui: Any) -> None:
        self._ui = ui
        ui.sourceComboBox.currentIndexChanged.connect(self._on_source)
        ui.posesComboBox.currentIndexChanged.connect(self._on_poses)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return _text(self._ui.robotNameLineEdit)

    def choose(self, name: str) -> None:
        """Put the name of a robot into its field."""
        self._ui.robotNameLineEdit.setText(name)

    def add(self, logic: Ros2Api) -> Any:
        """Add the robot; None, with a log line, if it was not added. Raises `MarginGuardError`."""
        ui, source = self._ui, self._source()
        path = str(ui.descriptionPathLineEdit.property("currentPath")).strip()
        return logic.AddRobot(
            self.name,
            _text(ui.parameterNodeLineEdit) if source in (PARAMETER, MESH_MAP) else "",
            path if source == FILE else _text(ui.parameterLineEdit),
            _text(ui.fixedFrameLineEdit),
            _text(ui.tfPrefixLineEdit),
            source,
            _text(ui.jointStatesLineEdit) if self._follows_joints() else "",
        )

    def _source(self) -> str:
        return str(self._ui.sourceComboBox.property("currentText"))

    def _follows_joints(self) -> bool:
        return str(self._ui.posesComboBox.property("currentText")) == _JOINT_STATES

    def _on_source(self, _: int) -> None:
        source = self._source()
        node, name = DEFAULTS[source]
        ui = self._ui
        ui.parameterNodeLineEdit.setEnabled(source in (PARAMETER, MESH_MAP))
        ui.parameterLineEdit.setEnabled(source in (PARAMETER, TOPIC, MESH_MAP))
        ui.descriptionPathLineEdit.setEnabled(source == FILE)
        ui.parameterNodeLineEdit.setText(node)
        ui.parameterLineEdit.setText(name)

    def _on_poses(self, _: int) -> None:
        self._ui.jointStatesLineEdit.setEnabled(self._follows_joints())


def _text(field: Any) -> str:
    return str(field.property("text")).strip()
