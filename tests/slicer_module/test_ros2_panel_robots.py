"""Robot fields and tables of the ROS2 panel, with TEST DOUBLES of desktop Slicer."""

import pytest

from tests.slicer_module.ros2_panel_checks import make_panel as make_panel
from tests.slicer_module.ros2_panel_checks import module as module
from tests.slicer_module.ros2_values import URDF
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def panel(make_panel):
    return make_panel()


def cells(table):
    return [
        [table.item(row, column).text() for column in range(table.columnCount())]
        for row in range(table.rowCount())
    ]


def test_fields_follow_the_source_of_the_description(panel):
    ui = panel.ui
    expected = {
        "parameter": ("/robot_state_publisher", "robot_description", True, True, False),
        "topic": ("", "/robot_description", False, True, False),
        "file": ("", "", False, False, True),
        "mesh map": ("/ambf", "/ambf/rigid_body_mesh_path_map", True, True, False),
    }
    for source in (*list(expected)[1:], "parameter"):
        ui.sourceComboBox.setCurrentText(source)
        fields = (ui.parameterNodeLineEdit, ui.parameterLineEdit, ui.descriptionPathLineEdit)
        assert (
            *(field.text() for field in fields[:2]),
            *(field.isEnabled() for field in fields),
        ) == expected[source]
    assert not ui.jointStatesLineEdit.isEnabled()
    ui.posesComboBox.setCurrentText("joint states")
    assert ui.jointStatesLineEdit.isEnabled()


def test_several_robots_are_added_listed_and_removed(panel, peer, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    ui, table = panel.ui, panel.ui.robotsTableWidget
    ui.sourceComboBox.setCurrentText("file")
    ui.descriptionPathLineEdit.setText(str(path))
    ui.robotNameLineEdit.setText("left")
    ui.tfPrefixLineEdit.setText("left")
    ui.addRobotButton.click()
    ui.robotNameLineEdit.setText("right")
    ui.posesComboBox.setCurrentText("joint states")
    ui.jointStatesLineEdit.setText("/right/joint_states")
    ui.addRobotButton.click()
    node = panel.logic.GetDefaultROS2Node()
    robots = [node.GetRobotNodeByName(name) for name in ("left", "right")]
    wait_until(lambda: all(robot.GetLinkNames() for robot in robots), panel.logic.Spin)
    panel._list()
    assert [row[:3] for row in cells(table)] == [["left", "slicer", "3"], ["right", "slicer", "3"]]
    assert "missing" in cells(table)[0][3]
    assert cells(table)[1][3] == "joints without a position: turn"
    table.cellClicked.emit(0, 0)
    assert ui.robotNameLineEdit.text() == "left"
    ui.removeRobotButton.click()
    assert [row[0] for row in cells(table)] == ["right"]


def test_topics_are_listed_with_types_and_counts(panel):
    node = panel.logic.GetDefaultROS2Node()
    other = panel.logic.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    other.Create("other")
    node.CreateAndAddPublisherNode("String", "/text").Publish("x")
    node.CreateAndAddSubscriberNode("Pose", "/poses")
    other.CreateAndAddSubscriberNode("Wrench", "/force")
    panel._list()
    assert cells(panel.ui.publishersTableWidget) == [["/text", "std_msgs/msg/String", "1"]]
    assert cells(panel.ui.subscribersTableWidget) == [
        ["/poses", "geometry_msgs/msg/Pose", "0"],
        ["/force", "geometry_msgs/msg/Wrench", "0"],
    ]
    other.Destroy()
    panel._list()
    assert len(cells(panel.ui.subscribersTableWidget)) == 1


def test_tables_count_what_another_process_receives_and_sends(panel, peer, hear):
    node = panel.logic.GetDefaultROS2Node()
    publisher = node.CreateAndAddPublisherNode("String", "/panel/text")
    subscriber = node.CreateAndAddSubscriberNode("Int", "/panel/number")
    hear(publisher)
    publisher.Publish("x")
    assert peer("take", topic="/panel/text") == [{"data": "x"}]
    messages = [{"data": 1}, {"data": 2}]
    peer("publish", topic="/panel/number", type="std_msgs/msg/Int64", messages=messages)
    wait_until(lambda: subscriber.GetNumberOfMessages() == 2, panel.spin)
    panel._list()
    assert cells(panel.ui.publishersTableWidget) == [["/panel/text", "std_msgs/msg/String", "1"]]
    assert cells(panel.ui.subscribersTableWidget) == [["/panel/number", "std_msgs/msg/Int64", "2"]]
