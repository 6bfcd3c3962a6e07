"""Tables of the panel: robots, subscribers and publishers of all ROS nodes in the scene."""

from collections.abc import Callable
from typing import Any

from ROS2Lib.logic import Ros2Api
from ROS2Lib.publisher import vtkMRMLROS2PublisherNode
from ROS2Lib.robot import vtkMRMLROS2RobotNode
from ROS2Lib.subscriber import vtkMRMLROS2SubscriberNode

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
