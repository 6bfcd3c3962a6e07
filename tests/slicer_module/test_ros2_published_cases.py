"""The 15 cases of SlicerROS2's published tests, each against a process with rclpy alone.

The calls are theirs, also ``slicer.mrmlScene.AddNewNodeByClass``; the texts are not. They wait for
events instead of fixed times. Instead of turtlesim, which needs a display, the peer process has a
node with its name, parameters and service.
"""

import math

import pytest
import slicer
import vtk

TURN = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
ROUNDED = ((0.707, -0.707, 0), (0.707, 0.707, 0), (0, 0, 1))
ROUNDED_30 = ((0.866, -0.5, 0), (0.5, 0.866, 0), (0, 0, 1))


@pytest.fixture
def ros2_node(logic, monkeypatch):
    """A ROS node made as the scripts make it; ``slicer.mrmlScene`` is the scene of the logic."""
    monkeypatch.setattr(slicer, "mrmlScene", logic.scene, raising=False)
    made = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    made.Create("testNode")
    yield made
    made.Destroy()
    logic.Spin()


class Observer:
    """Counts the events of a subscriber and keeps the text of its last message."""

    def __init__(self):
        self.counter = 0
        self.yaml = ""

    def callback(self, caller, event):
        self.yaml = caller.GetLastMessageYAML()
        self.counter += 1


@pytest.fixture
def round_trip(ros2_node, peer, spin_until):
    """Publish ``value(publisher)`` once; returns what subscriber and peer process receive."""

    def send(kind, value):
        topic = f"slicer_test_{kind.lower()}"
        publisher = ros2_node.CreateAndAddPublisherNode(kind, topic)
        subscriber = ros2_node.CreateAndAddSubscriberNode(kind, topic)
        observer = Observer()
        tag = subscriber.AddObserver("ModifiedEvent", observer.callback)
        peer("listen", topic=f"/{topic}", type=publisher.GetROSType())
        assert ros2_node.ros.wait_for_subscribers(publisher._publisher.topic, 2, 15.0)
        before = subscriber.GetNumberOfMessages()
        assert publisher.Publish(value(publisher)) == 2
        spin_until(lambda: subscriber.GetNumberOfMessages() > before)
        for _ in range(10):
            ros2_node.Spin()
        assert subscriber.GetNumberOfMessages() - before == 1
        assert observer.counter == 1
        assert observer.yaml == subscriber.GetLastMessageYAML()
        received = subscriber.GetLastMessage()
        (at_peer,) = peer("take", topic=f"/{topic}")
        subscriber.RemoveObserver(tag)
        assert ros2_node.RemoveAndDeletePublisherNode(topic) is True
        assert ros2_node.RemoveAndDeleteSubscriberNode(topic) is True
        return received, at_peer

    return send


def test_1_node_of_another_process_appears_and_leaves(ros2_node, peer, spin_until):
    peer("start_turtlesim")
    spin_until(lambda: "turtlesim" in ros2_node.ros.node.get_node_names())
    peer("stop_turtlesim")
    spin_until(lambda: "turtlesim" not in ros2_node.ros.node.get_node_names())


@pytest.mark.parametrize(
    ("kind", "sent", "data"),
    [("Empty", "", None), ("String", "xkcd", "xkcd"), ("Double", 3.1415, 3.1415)],
    ids=["2_empty", "3_string", "4_double"],
)
def test_plain_value(round_trip, kind, sent, data):
    received, at_peer = round_trip(kind, lambda _: sent)
    assert received == sent
    assert at_peer.get("data") == data


def matrix(rows, translation):
    made = vtk.vtkMatrix4x4()
    for row in range(3):
        for column in range(3):
            made.SetElement(row, column, rows[row][column])
        made.SetElement(row, 3, translation[row])
    return made


def test_5_pose(round_trip):
    sent = vtk.vtkMatrix4x4()
    sent.SetElement(2, 3, 3.1415)
    received, at_peer = round_trip("Pose", lambda _: sent)
    assert received.GetElement(2, 3) == sent.GetElement(2, 3)
    assert at_peer["position"]["z"] == pytest.approx(0.0031415)


@pytest.mark.parametrize(
    ("kind", "array", "values"),
    [
        ("IntArray", vtk.vtkIntArray, [1, 2, 3, 4, 5]),
        ("DoubleArray", vtk.vtkDoubleArray, [1.1, 2.2, 3.3, 4.4, 5.5]),
    ],
    ids=["6_int_array", "7_double_array"],
)
def test_array(round_trip, kind, array, values):
    sent = array()
    sent.SetNumberOfValues(len(values))
    for index, value in enumerate(values):
        sent.SetValue(index, value)
    received, at_peer = round_trip(kind, lambda _: sent)
    assert received.GetNumberOfValues() == len(values)
    assert [received.GetValue(index) for index in range(len(values))] == values
    assert at_peer["data"] == values


def test_8_wrench_stamped(round_trip):
    values = [1.1, 2.2, 3.3, 4.4, 5.5, 6.6]

    def fill(publisher):
        message = publisher.GetBlankMessage()
        message.GetWrench().SetNumberOfValues(6)
        for index, value in enumerate(values):
            message.GetWrench().SetValue(index, value)
        return message

    received, at_peer = round_trip("WrenchStamped", fill)
    assert [received.GetWrench().GetValue(index) for index in range(6)] == values
    assert at_peer["wrench"]["force"] == {"x": 1.1, "y": 2.2, "z": 3.3}
    assert at_peer["wrench"]["torque"] == {"x": 4.4, "y": 5.5, "z": 6.6}


def test_9_pose_array(round_trip):
    poses = (
        matrix(TURN, (1.0, 2.0, 3.0)),
        matrix(ROUNDED, (4.0, 5.0, 6.0)),
        matrix(ROUNDED_30, (7.0, 8.0, 9.0)),
    )

    def fill(publisher):
        message = publisher.GetBlankMessage()
        message.GetHeader().SetFrameId("test_frame")
        message.GetHeader().GetStamp().SetSec(123)
        message.GetHeader().GetStamp().SetNanosec(456)
        message.SetPoses(poses)
        return message

    received, at_peer = round_trip("PoseArray", fill)
    header = received.GetHeader()
    assert header.GetFrameId() == "test_frame"
    assert (header.GetStamp().GetSec(), header.GetStamp().GetNanosec()) == (123, 456)
    assert len(received.GetPoses()) == 3
    for sent, found in zip(poses, received.GetPoses(), strict=True):
        for row in range(4):
            for column in range(4):
                assert abs(sent.GetElement(row, column) - found.GetElement(row, column)) < 5e-4
    assert at_peer["header"] == {"stamp": {"sec": 123, "nanosec": 456}, "frame_id": "test_frame"}
    assert at_peer["poses"][0]["orientation"]["z"] == pytest.approx(math.sqrt(0.5))


@pytest.mark.parametrize(
    ("kind", "array", "columns"),
    [
        ("IntTable", vtk.vtkIntArray, [[0, 3, 6], [1, 5, 9]]),
        ("DoubleTable", vtk.vtkDoubleArray, [[0.0, 3.3, 6.6], [1.1, 5.5, 9.9]]),
    ],
    ids=["10_int_table", "11_double_table"],
)
def test_table(round_trip, kind, array, columns):
    sent = vtk.vtkTable()
    for values in columns:
        column = array()
        column.SetNumberOfValues(3)
        for index, value in enumerate(values):
            column.SetValue(index, value)
        sent.AddColumn(column)
    received, at_peer = round_trip(kind, lambda _: sent)
    assert (received.GetNumberOfColumns(), received.GetNumberOfRows()) == (2, 3)
    for row in range(3):
        for column in range(2):
            assert received.GetValue(row, column) == sent.GetValue(row, column)
    assert at_peer["data"] == [value for pair in zip(*columns, strict=True) for value in pair]


def test_12_publisher_and_subscriber_are_deleted_once(ros2_node, peer, logic):
    topic = "test_string_xkcd"
    ros2_node.CreateAndAddPublisherNode("vtkMRMLROS2PublisherStringNode", topic)
    ros2_node.CreateAndAddSubscriberNode("vtkMRMLROS2SubscriberStringNode", topic)
    peer("wait_until", call={"do": "endpoints", "topic": f"/{topic}"}, value=[1, 1])
    for remove in (
        ros2_node.RemoveAndDeletePublisherNode,
        ros2_node.RemoveAndDeleteSubscriberNode,
    ):
        results = []
        for name in (topic, topic, "random_name"):
            results.append(remove(name))
            logic.Spin()
        assert results == [True, False, False]
    peer("wait_until", call={"do": "endpoints", "topic": f"/{topic}"}, value=[0, 0])


def test_13_parameters_of_another_process(ros2_node, peer, spin_until):
    peer("start_turtlesim")
    try:
        parameters = ros2_node.CreateAndAddParameterNode("/turtlesim")
        for name in ("background_r", "background_y", "background_g"):
            assert [parameters.GetParameterType(name) for _ in range(2)] == ["", ""]
        parameters.AddParameter("background_r")
        parameters.AddParameter("background_y")
        spin_until(lambda: parameters.IsParameterSet("background_r"))
        assert parameters.GetParameterType("background_r") == "integer"
        assert parameters.IsParameterSet("background_y", True) is False
        assert parameters.GetParameterType("background_y") == ""
        assert peer("set_parameter", name="background_g", value=150, of="turtlesim")
        spin_until(lambda: parameters.IsParameterSet("background_g", True))
        assert parameters.IsParameterSet("background_g")
        assert parameters.GetParameterType("background_g") == "integer"
        assert parameters.GetParameterAsInteger("background_g") == 150
        assert ros2_node.RemoveAndDeleteParameterNode("/turtlesim") is True
        ros2_node.CreateAndAddParameterNode("/turtlesim")
        names = ("/turtlesim", "/turtlesim", "/random_name")
        assert [ros2_node.RemoveAndDeleteParameterNode(name) for name in names] == [
            True,
            False,
            False,
        ]
    finally:
        peer("stop_turtlesim")


def test_14_broadcast_is_looked_up_with_an_event_per_spin(ros2_node, peer, spin_until):
    broadcaster = ros2_node.CreateAndAddTf2BroadcasterNode("Parent", "Child")
    lookup = ros2_node.CreateAndAddTf2LookupNode("Parent", "Child")
    seen = []

    def moved(caller, event):
        pose = vtk.vtkMatrix4x4()
        caller.GetMatrixTransformToParent(pose)
        seen.append(pose.GetElement(0, 3))

    tag = lookup.AddObserver(slicer.vtkMRMLTransformNode.TransformModifiedEvent, moved)
    peer("listen", topic="/tf", type="tf2_msgs/msg/TFMessage")
    zero = vtk.vtkMatrix4x4()
    spin_until(lambda: broadcaster.Broadcast(zero) and peer("has_edge", child="Child", x=0.0))
    seen.clear()  # both sides have discovered each other
    sent = vtk.vtkMatrix4x4()
    sent.SetElement(0, 3, 66)
    assert broadcaster.Broadcast(sent) is True
    spin_until(lambda: seen.count(66) > 1)
    found = vtk.vtkMatrix4x4()
    lookup.GetMatrixTransformToParent(found)
    assert found.GetElement(0, 3) == sent.GetElement(0, 3)
    assert seen[-1] == sent.GetElement(0, 3)
    spin_until(lambda: peer("has_edge", child="Child", x=0.066))
    lookup.RemoveObserver(tag)
    for remove in (
        ros2_node.RemoveAndDeleteTf2LookupNode,
        ros2_node.RemoveAndDeleteTf2BroadcasterNode,
    ):
        assert [remove("Parent", "Child") for _ in range(2)] == [True, False]


def test_15_service_is_answered(ros2_node, peer, spin_until):
    has_spawn = peer("start_turtlesim")
    try:
        kind = "vtkMRMLROS2ServiceClientSpawnNode" if has_spawn else "Trigger"
        client = ros2_node.CreateAndAddServiceClientNode(kind, "/spawn")
        request = client.CreateBlankRequest()
        if has_spawn:
            request.SetX(4.0)
            request.SetY(4.0)
        assert client.SendAsyncRequest(request) == 1
        spin_until(client.GetLastResponseStatus)
        response = client.GetLastResponse()
        assert (response.GetName() if has_spawn else response.GetMessage()) == "turtle2"
    finally:
        peer("stop_turtlesim")
