"""Panel of the ROS2 module from its real .ui, with TEST DOUBLES of desktop Slicer."""

import importlib.util
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import slicer

from tests.slicer_module.desktop import desktop_slicer

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).resolve().parents[2] / "slicer_module" / "ROS2"
BUTTONS = {
    element.get("name")
    for element in ElementTree.parse(FOLDER / "Resources" / "UI" / "ROS2.ui").iter("widget")
    if element.get("class") == "QPushButton"
}


@pytest.fixture(scope="module")
def module():
    """ROS2.py, imported like Slicer does."""
    with desktop_slicer():
        spec = importlib.util.spec_from_file_location("ROS2", FOLDER / "ROS2.py")
        found = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(found)
        yield found


@pytest.fixture
def make_panel(module, application, domain, monkeypatch):
    from tests.slicer_module.slicer_double import panel_parent

    monkeypatch.setattr(slicer, "mrmlScene", application.scene, raising=False)
    interval, before = sys.getswitchinterval(), set(dir(slicer))
    made = []

    def make():
        made.append(module.ROS2Widget(panel_parent(FOLDER)))
        made[-1].setup()
        return made[-1]

    yield make
    for widget in made:
        widget.cleanup()
    sys.setswitchinterval(interval)
    for name in set(dir(slicer)) - before:
        delattr(slicer, name)


def test_module_describes_itself(module):
    class Parent:
        pass

    parent = Parent()
    module.ROS2(parent)
    assert parent.title == "ROS2"
    assert "docs/ros2_module.md" in parent.helpText


def test_scripts_find_the_default_node_and_the_classes(make_panel):
    panel = make_panel()
    node = slicer.mrmlScene.GetFirstNodeByName("ros2:node:slicer")
    assert panel.logic.GetDefaultROS2Node() is node
    other = slicer.mrmlScene.AddNode(slicer.vtkMRMLROS2NodeNode())
    other.Create("other")
    publisher = slicer.mrmlScene.AddNode(slicer.vtkMRMLROS2PublisherStringNode())
    assert publisher.AddToROS2Node(other.GetID(), "/text")
    assert slicer.vtkMRMLROS2ParameterNode.ParameterModifiedEvent > 1000
    panel.spin()
    slicer.mrmlScene.Clear()
    slicer.mrmlScene.InvokeEvent(slicer.vtkMRMLScene.EndCloseEvent)
    again = slicer.mrmlScene.GetFirstNodeByName("ros2:node:slicer")
    assert again is not node
    assert again.IsCreated()
    assert not node.IsCreated()


def test_buttons_add_and_remove_a_robot(make_panel, peer):
    panel = make_panel()
    assert {"addRobotButton", "removeRobotButton"} == BUTTONS
    defaults = [
        getattr(panel.ui, f"{name}LineEdit").property("text")
        for name in ("robotName", "parameterNode", "parameter", "fixedFrame", "tfPrefix")
    ]
    assert defaults == ["robot1", "/robot_state_publisher", "robot_description", "", ""]
    panel.ui.addRobotButton.click()
    assert panel.logic.GetDefaultROS2Node().GetRobotNodeByName("robot1") is not None
    assert "ros2:robot:robot1: no description yet" in panel.ui.nodesLabel.text()
    panel.ui.addRobotButton.click()
    assert panel.ui.messageLabel.text() == "robot 'robot1' was not added: see the log"
    panel.ui.removeRobotButton.click()
    assert panel.ui.messageLabel.text() == ""
    assert panel.ui.nodesLabel.text() == "ros2:node:slicer"
    panel.ui.removeRobotButton.click()
    assert panel.ui.messageLabel.text() == "there is no robot 'robot1'"


def test_button_shows_why_there_is_no_ros_node(make_panel, monkeypatch):
    panel = make_panel()
    panel.logic.Destroy()
    monkeypatch.setattr("ROS2Lib.logic.DEFAULT_NODE", "two words")
    for button in (panel.ui.addRobotButton, panel.ui.removeRobotButton):
        panel.ui.messageLabel.setText("")
        button.click()
        assert "ROS node 'two words' cannot be started" in panel.ui.messageLabel.text()


def test_list_shows_the_status_of_each_member(make_panel):
    panel = make_panel()
    node = panel.logic.GetDefaultROS2Node()
    node.CreateAndAddPublisherNode("String", "/text").Publish("x")
    node.CreateAndAddSubscriberNode("Pose", "/poses")
    node.CreateAndAddServiceClientNode("Trigger", "/missing")
    node.CreateAndAddParameterNode("/missing")
    node.CreateAndAddTf2BroadcasterNode("a", "b")
    node.CreateAndAddTf2LookupNode("c", "d")
    panel._list()
    assert panel.ui.nodesLabel.text().split("\n") == [
        "ros2:node:slicer",
        "    ros2:pub:/text: std_msgs/msg/String, 1 sent",
        "    ros2:sub:/poses: geometry_msgs/msg/Pose, 0 received",
        "    ros2:srv:client:/missing: std_srvs/srv/Trigger, no request was sent",
        "    ros2:param:/missing: 0 known, the node is not available",
        "    ros2:tf2broadcaster:aTob: 0 sent",
        "    ros2:tf2lookup:cTod: missing",
    ]


def test_message_is_in_the_scene_without_a_timer(make_panel, peer):
    from benchmarks.latency.qt_loops import quit_loop, run_releasing

    panel = make_panel()
    node = panel.logic.GetDefaultROS2Node()
    texts = node.CreateAndAddSubscriberNode("String", "/woken")
    pose = node.CreateAndAddTf2LookupNode("woken_parent", "woken_child")
    panel._spinner._watchdog.stop()
    panel._list_timer.stop()
    texts.AddObserver("ModifiedEvent", lambda *_: quit_loop())
    message = {"topic": "/woken", "type": "std_msgs/msg/String", "messages": [{"data": "now"}]}
    peer.begin("publish", **message)
    run_releasing()
    peer.result()
    assert texts.GetLastMessage() == "now"

    pose.AddObserver(slicer.vtkMRMLTransformNode.TransformModifiedEvent, lambda *_: quit_loop())
    peer.begin("send_tf", edges=[["woken_parent", "woken_child", [0.5, 0.0, 0.0]]])
    run_releasing()
    peer.result()
    assert pose.GetMatrixTransformToParent().GetElement(0, 3) == 500.0


def test_answers_and_parameters_are_in_the_scene_without_a_timer(make_panel, peer):
    from benchmarks.latency.qt_loops import quit_loop, run_releasing

    panel = make_panel()
    node = panel.logic.GetDefaultROS2Node()
    parameters = node.CreateAndAddParameterNode("/peer")
    client = node.CreateAndAddServiceClientNode("SetBool", "/peer/echo")
    panel._spinner._watchdog.stop()
    panel._list_timer.stop()
    parameters.AddObserver(parameters.ParameterModifiedEvent, lambda *_: quit_loop())
    parameters.AddParameter("count")
    run_releasing()
    assert parameters.GetParameterAsInteger("count") == 7

    client.AddObserver("ModifiedEvent", lambda *_: quit_loop())
    client.SendAsyncRequest(client.CreateBlankRequest())
    run_releasing()
    assert client.GetLastResponseStatus()


def test_silent_source_becomes_stale_in_the_scene_without_a_message(make_panel, peer):
    from benchmarks.latency.qt_loops import quit_loop, run_releasing

    publishers, others = peer("endpoints", topic="/tf")
    panel = make_panel()
    pose = panel.logic.GetDefaultROS2Node().CreateAndAddTf2LookupNode("once_parent", "once_child")
    peer("wait_until", call={"do": "endpoints", "topic": "/tf"}, value=[publishers, others + 1])
    states = []

    def note(*_):
        if pose.GetAttribute("ros2.state") not in states[-1:]:
            states.append(pose.GetAttribute("ros2.state"))
        if states[-1] == "stale":
            quit_loop()

    pose.AddObserver("ModifiedEvent", note)
    for _ in range(20):  # on a busy machine the pose can be too old when it is shown first
        states.clear()
        peer.begin("send_tf", edges=[["once_parent", "once_child", [0.5, 0.0, 0.0]]])
        run_releasing()
        peer.result()
        if "valid" in states:
            break
    assert states[-2:] == ["valid", "stale"]


def test_unloaded_module_spins_no_more_and_leaves_no_descriptor_open(make_panel):
    from benchmarks.latency.qt_loops import run_releasing

    make_panel().cleanup()
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        panel = make_panel()
        panel.cleanup()
    assert len(list(Path("/proc/self/fd").iterdir())) == before
    assert slicer.mrmlScene.GetFirstNodeByName("ros2:node:slicer") is None
    spins = []
    panel.logic.Spin = lambda: spins.append(None)
    panel._received()
    run_releasing(250)
    assert spins == []
    panel.cleanup()


def test_panel_without_ros_shows_the_reason(module, make_panel, monkeypatch):
    monkeypatch.setitem(sys.modules, "ROS2Lib.logic", None)
    panel = make_panel()
    assert panel.logic is None
    text = panel.layout.itemAt(0).widget().text()
    assert text.startswith("ROS 2 cannot be loaded (")
    assert text.endswith("start Slicer with 'marginguard slicer --slicer PATH'")
