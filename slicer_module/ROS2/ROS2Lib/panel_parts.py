"""Parts of the panel: tables of robots, subscribers and publishers, and the form of a robot."""

from collections.abc import Callable
from typing import Any

from ROS2Lib.logic import Ros2Api
from ROS2Lib.robot import DEFAULTS, FILE, MESH_MAP, PARAMETER, TOPIC, vtkMRMLROS2RobotNode
from ROS2Lib.topic_nodes import vtkMRMLROS2PublisherNode, vtkMRMLROS2SubscriberNode

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
