"""SlicerROS2's names of nodes, topics and messages, each against a process with rclpy alone."""

import logging
from types import SimpleNamespace

import pytest
import vtk

from app.geometry import MarginGuardError
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def namespace():
    """Stands for the module ``slicer``, to which the panel adds the classes."""
    from ROS2Lib.class_names import register_classes

    made = SimpleNamespace()
    register_classes(made)
    return made


@pytest.mark.parametrize(
    ("reliability", "durability", "expected"),
    [
        ("Reliable", "TransientLocal", ["RELIABLE", "TRANSIENT_LOCAL"]),
        ("BestEffort", "Volatile", ["BEST_EFFORT", "VOLATILE"]),
        ("ReliabilitySystemDefault", "DurabilitySystemDefault", ["RELIABLE", "VOLATILE"]),
    ],
)
def test_quality_of_service_is_seen_by_the_peer(
    logic, node, peer, reliability, durability, expected
):
    topic = f"/quality_{reliability.lower()}"
    made = []
    for role in ("Publisher", "Subscriber"):
        each = logic.AddNewNodeByClass(f"vtkMRMLROS2{role}StringNode")
        each.SetQoSHistoryDepth(7)
        each.SetQoSReliability(getattr(each, reliability))
        each.SetQoSDurability(getattr(each, durability))
        assert each.IsAddedToROS2Node() is False
        assert each.AddToROS2Node(node.GetID(), topic) is True
        assert each.IsAddedToROS2Node() is True
        made.append(each)
    call = {"do": "qualities", "topic": topic}
    peer("wait_until", call=call, value=[expected, expected])
    for each in made:
        assert each.RemoveFromROS2Node(node.GetID(), topic) is True
        assert each.IsAddedToROS2Node() is False
        logic.scene.RemoveNode(each)
    peer("wait_until", call=call, value=[])


def test_last_message_of_the_peer_in_every_form(node, peer, spin_until):
    subscriber = node.CreateAndAddSubscriberNode("Double", "/judged/depth")
    assert (subscriber.GetTopic(), subscriber.GetROSType()) == (
        "/judged/depth",
        "std_msgs/msg/Float64",
    )
    assert (subscriber.GetSlicerType(), subscriber.GetBlankMessage()) == ("float", 0.0)
    number = vtk.reference(3.0)
    assert (subscriber.GetLastMessage(number), number.get()) == (False, 3.0)
    assert not subscriber.GetLastMessageVariant().IsValid()
    peer("publish", topic="/judged/depth", type="std_msgs/msg/Float64", messages=[{"data": 7.5}])
    spin_until(lambda: subscriber.GetNumberOfMessages() == 1)
    assert subscriber.GetLastMessage(number) is True
    assert number.get() == subscriber.GetLastMessage() == 7.5
    assert subscriber.GetLastMessageVariant().ToDouble() == 7.5
    assert subscriber.GetLastMessageYAML() == "data: 7.5\n"
    with pytest.raises(MarginGuardError, match="output argument is list"):
        subscriber.GetLastMessage([])


def test_matrix_is_copied_into_an_output_argument(node, peer, spin_until):
    subscriber = node.CreateAndAddSubscriberNode("Pose", "/judged/tip")
    pose = {"position": {"x": 0.012}, "orientation": {"w": 1.0}}
    peer("publish", topic="/judged/tip", type="geometry_msgs/msg/Pose", messages=[pose])
    spin_until(subscriber.GetNumberOfMessages)
    found = vtk.vtkMatrix4x4()
    assert subscriber.GetLastMessage(found) is True
    variant = subscriber.GetLastMessageVariant().ToVTKObject()
    assert variant.GetElement(0, 3) == found.GetElement(0, 3) == pytest.approx(12.0)


def test_constructed_message_reaches_the_peer(namespace, node, peer, hear):
    publisher = node.CreateAndAddPublisherNode("PoseStamped", "/judged/pose")
    hear(publisher)
    blank = publisher.GetBlankMessage()
    assert blank.GetClassName() == publisher.GetSlicerType() == "vtkGeometryMsgsPoseStamped"
    header = namespace.vtkStdMsgsHeader()
    header.SetFrameId("needle")
    message = namespace.vtkGeometryMsgsPoseStamped()
    message.SetHeader(header)
    message.GetPose().SetElement(0, 3, 12.0)
    assert [publisher.Publish(each) for each in (blank, message)] == [1, 1]
    assert (publisher.GetNumberOfCalls(), publisher.GetNumberOfMessagesSent()) == (2, 2)
    first, second = peer("take", topic="/judged/pose", count=2)
    assert first["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert second["header"]["frame_id"] == "needle"
    assert second["pose"]["position"]["x"] == pytest.approx(0.012)


def test_constants_are_those_of_the_peers_message(namespace, node, peer, spin_until):
    kind = "sensor_msgs/msg/PointField"
    subscriber = node.CreateAndAddSubscriberNode(kind, "/judged/field")
    field = namespace.vtkSensorMsgsPointField
    peer("publish", topic="/judged/field", type=kind, messages=[{"name": "x", "datatype": 7}])
    spin_until(subscriber.GetNumberOfMessages)
    assert subscriber.GetLastMessage().GetDatatype() == field.FLOAT32


def test_node_that_does_not_spin_receives_nothing(logic, node, peer, caplog):
    caplog.set_level(logging.WARNING)
    idle = logic.AddNewNodeByClass("vtkMRMLROS2NodeNode")
    idle.Create("idle")
    peer("wait_until", call={"do": "has_node", "name": "idle"}, value=True)
    subscriber = idle.CreateAndAddSubscriberNode("String", "/judged/idle")
    peer("publish", topic="/judged/idle", type="std_msgs/msg/String", messages=[{"data": "x"}])
    assert (idle.GetSpinning(), subscriber.GetNumberOfMessages()) == (False, 0)
    idle.WarnIfNotSpinning("judged")
    node.Spin()
    assert node.GetSpinning() is True
    node.WarnIfNotSpinning("judged")
    warned = [each.getMessage() for each in caplog.records if "spinning" in each.getMessage()]
    assert warned == ["judged: ros2:node:idle is not spinning; call Spin"]
    wait_until(subscriber.GetNumberOfMessages, idle.Spin)
    assert idle.GetSpinning() is True
    assert idle.GetROS2NodeName() == "idle"
    idle.Destroy()
    assert idle.GetSpinning() is False
    peer("wait_until", call={"do": "has_node", "name": "idle"}, value=False)


def test_references_follow_what_the_peer_sees(logic, node, peer):
    made = {
        "publisher": node.CreateAndAddPublisherNode("String", "/judged/ref"),
        "subscriber": node.CreateAndAddSubscriberNode("String", "/judged/ref"),
        "service_client": node.CreateAndAddServiceClientNode("SetBool", "/peer/echo"),
        "parameter": node.CreateAndAddParameterNode("/peer"),
        "broadcaster": node.CreateAndAddTf2BroadcasterNode("judged", "ref"),
        "lookup": node.CreateAndAddTf2LookupNode("judged", "ref"),
        "robot": node.CreateAndAddRobotNode("judged", "/robot_state_publisher"),
    }
    second = node.CreateAndAddPublisherNode("String", "/judged/second")
    topic = {"do": "endpoints", "topic": "/judged/ref"}
    peer("wait_until", call=topic, value=[1, 1])
    assert "/peer/echo" in peer("clients_of", name="slicer")
    assert node.GetNumberOfNodeReferences("publisher") == 2
    for role, member in made.items():
        assert node.GetNthNodeReference(role, 0) is member
        assert member.GetNodeReference("node") is node
        assert member.RemoveFromROS2Node(node.GetID()) is True
        assert node.GetNthNodeReference(role, 0) is (second if role == "publisher" else None)
        assert member.GetNodeReference("node") is None
        logic.scene.RemoveNode(member)
    peer("wait_until", call=topic, value=[0, 0])
    peer("wait_until", call={"do": "clients_of", "name": "slicer"}, value=[])
    assert second.RemoveFromROS2Node(node.GetID(), "/judged/second")
    assert all(node.GetNumberOfNodeReferences(role) == 0 for role in made)
