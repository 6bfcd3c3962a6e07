"""The 15 cases of SlicerROS2's published tests, each against a process with rclpy alone.

The calls are theirs, also ``slicer.mrmlScene.AddNewNodeByClass``; the texts are not. They wait for
events instead of fixed times. Instead of turtlesim, which needs a display, the peer process has a
node with its name, parameters and service.
"""

import pytest
import slicer

from tests.slicer_module.ros2_values import (
    columns,
    doubles,
    flat,
    ints,
    matrix,
    rows,
    shifted,
    table,
    x_mm,
)

pytestmark = pytest.mark.slow

TURN = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
ROUNDED = ((0.707, -0.707, 0), (0.707, 0.707, 0), (0, 0, 1))
ROUNDED_30 = ((0.866, -0.5, 0), (0.5, 0.866, 0), (0, 0, 1))
POSES = (
    matrix(TURN, (1.0, 2.0, 3.0)),
    matrix(ROUNDED, (4.0, 5.0, 6.0)),
    matrix(ROUNDED_30, (7.0, 8.0, 9.0)),
)


@pytest.fixture
def ros2_node(logic, monkeypatch):
    """A ROS node made as the scripts make it; ``slicer.mrmlScene`` is the scene of the logic."""
    monkeypatch.setattr(slicer, "mrmlScene", logic.scene, raising=False)
    made = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    made.Create("testNode")
    return made


@pytest.fixture
def turtlesim(peer):
    """The node /turtlesim of the peer; True if turtlesim's messages are installed."""
    yield peer("start_turtlesim")
    peer("stop_turtlesim")


@pytest.fixture
def round_trip(ros2_node, peer, hear, spin_until):
    """Publish ``value(publisher)`` once; returns what subscriber and peer process receive."""

    def send(kind, value):
        topic = f"slicer_test_{kind.lower()}"
        publisher = ros2_node.CreateAndAddPublisherNode(kind, topic)
        subscriber = ros2_node.CreateAndAddSubscriberNode(kind, topic)
        texts = []
        tag = subscriber.AddObserver(
            "ModifiedEvent", lambda caller, event: texts.append(caller.GetLastMessageYAML())
        )
        hear(publisher, 2)
        before = subscriber.GetNumberOfMessages()
        assert publisher.Publish(value(publisher)) == 2
        spin_until(lambda: subscriber.GetNumberOfMessages() > before)
        for _ in range(10):
            ros2_node.Spin()
        assert subscriber.GetNumberOfMessages() - before == 1
        assert texts == [subscriber.GetLastMessageYAML()]
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
    ("kind", "sent", "read", "data"),
    [
        ("Empty", "", str, None),
        ("String", "xkcd", str, "xkcd"),
        ("Double", 3.1415, float, 3.1415),
        ("IntArray", ints(1, 2, 3, 4, 5), flat, [1, 2, 3, 4, 5]),
        ("DoubleArray", doubles(1.1, 2.2, 3.3, 4.4, 5.5), flat, [1.1, 2.2, 3.3, 4.4, 5.5]),
        ("IntTable", table(ints(0, 3, 6), ints(1, 5, 9)), columns, [0, 1, 3, 5, 6, 9]),
        (
            "DoubleTable",
            table(doubles(0.0, 3.3, 6.6), doubles(1.1, 5.5, 9.9)),
            columns,
            [0.0, 1.1, 3.3, 5.5, 6.6, 9.9],
        ),
    ],
    ids=[
        "2_empty",
        "3_string",
        "4_double",
        "6_int_array",
        "7_double_array",
        "10_int_table",
        "11_double_table",
    ],
)
def test_value(round_trip, kind, sent, read, data):
    received, at_peer = round_trip(kind, lambda _: sent)
    assert type(received) is type(sent)
    assert read(received) == read(sent)
    assert at_peer.get("data") == data


def test_5_pose(round_trip):
    received, at_peer = round_trip("Pose", lambda _: shifted(z_mm=3.1415))
    assert received.GetElement(2, 3) == 3.1415
    assert at_peer["position"]["z"] == pytest.approx(0.0031415)


def test_8_wrench_stamped(round_trip):
    values = [1.1, 2.2, 3.3, 4.4, 5.5, 6.6]

    def fill(publisher):
        message = publisher.GetBlankMessage()
        message.GetWrench().SetNumberOfValues(6)
        for index, value in enumerate(values):
            message.GetWrench().SetValue(index, value)
        return message

    received, at_peer = round_trip("WrenchStamped", fill)
    assert flat(received.GetWrench()) == values
    assert at_peer["wrench"]["force"] == {"x": 1.1, "y": 2.2, "z": 3.3}
    assert at_peer["wrench"]["torque"] == {"x": 4.4, "y": 5.5, "z": 6.6}


def test_9_pose_array(round_trip):
    def fill(publisher):
        message = publisher.GetBlankMessage()
        message.GetHeader().SetFrameId("test_frame")
        message.GetHeader().GetStamp().SetSec(123)
        message.GetHeader().GetStamp().SetNanosec(456)
        message.SetPoses(POSES)
        return message

    received, at_peer = round_trip("PoseArray", fill)
    header = received.GetHeader()
    assert header.GetFrameId() == "test_frame"
    assert (header.GetStamp().GetSec(), header.GetStamp().GetNanosec()) == (123, 456)
    assert len(received.GetPoses()) == 3
    for sent, found in zip(POSES, received.GetPoses(), strict=True):
        assert abs(rows(sent) - rows(found)).max() < 5e-4
    assert at_peer["header"] == {"stamp": {"sec": 123, "nanosec": 456}, "frame_id": "test_frame"}
    assert at_peer["poses"][0]["orientation"]["z"] == pytest.approx(0.5**0.5)


def test_12_publisher_and_subscriber_are_deleted_once(ros2_node, peer, logic):
    topic, scene = "test_string_xkcd", logic.scene
    call = {"do": "endpoints", "topic": f"/{topic}"}
    before = scene.GetNumberOfNodes()
    publisher = ros2_node.CreateAndAddPublisherNode("vtkMRMLROS2PublisherStringNode", topic)
    subscriber = ros2_node.CreateAndAddSubscriberNode("vtkMRMLROS2SubscriberStringNode", topic)
    peer("wait_until", call=call, value=[1, 1])
    for made, get, remove in (
        (publisher, ros2_node.GetPublisherNodeByTopic, ros2_node.RemoveAndDeletePublisherNode),
        (subscriber, ros2_node.GetSubscriberNodeByTopic, ros2_node.RemoveAndDeleteSubscriberNode),
    ):
        assert get(topic) is scene.GetFirstNodeByName(made.GetName()) is made
        results = []
        for name in (topic, topic, "random_name"):
            results.append(remove(name))
            logic.Spin()
        assert results == [True, False, False]
        assert get(topic) is None
        assert not made.IsAddedToROS2Node()
    assert scene.GetNumberOfNodes() == before
    peer("wait_until", call=call, value=[0, 0])


def test_13_parameters_of_another_process(ros2_node, peer, turtlesim, spin_until):
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
    removed = [ros2_node.RemoveAndDeleteParameterNode(name) for name in names]
    assert removed == [True, False, False]


def test_14_broadcast_is_looked_up_with_an_event_per_spin(ros2_node, peer, spin_until):
    broadcaster = ros2_node.CreateAndAddTf2BroadcasterNode("Parent", "Child")
    lookup = ros2_node.CreateAndAddTf2LookupNode("Parent", "Child")
    seen = []

    moved = slicer.vtkMRMLTransformNode.TransformModifiedEvent
    tag = lookup.AddObserver(moved, lambda caller, event: seen.append(x_mm(caller)))
    peer("listen", topic="/tf", type="tf2_msgs/msg/TFMessage")
    spin_until(lambda: broadcaster.Broadcast(shifted()) and peer("has_edge", child="Child", x=0.0))
    seen.clear()  # both sides have discovered each other
    assert broadcaster.Broadcast(shifted(66)) is True
    spin_until(lambda: seen.count(66) > 1)
    assert x_mm(lookup) == seen[-1] == 66
    spin_until(lambda: peer("has_edge", child="Child", x=0.066))
    lookup.RemoveObserver(tag)
    for remove in (
        ros2_node.RemoveAndDeleteTf2LookupNode,
        ros2_node.RemoveAndDeleteTf2BroadcasterNode,
    ):
        assert [remove("Parent", "Child") for _ in range(2)] == [True, False]


def test_15_service_is_answered(ros2_node, turtlesim, spin_until):
    kind = "vtkMRMLROS2ServiceClientSpawnNode" if turtlesim else "Trigger"
    client = ros2_node.CreateAndAddServiceClientNode(kind, "/spawn")
    request = client.CreateBlankRequest()
    if turtlesim:
        request.SetX(4.0)
        request.SetY(4.0)
    assert client.SendAsyncRequest(request) == 1
    spin_until(client.GetLastResponseStatus)
    response = client.GetLastResponse()
    assert (response.GetName() if turtlesim else response.GetMessage()) == "turtle2"
