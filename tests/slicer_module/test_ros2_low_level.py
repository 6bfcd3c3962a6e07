"""Calls of SlicerROS2 below its helper methods: nodes that a script makes and adds by itself."""

import logging

import pytest
import vtk

from app.geometry import MarginGuardError
from tests.slicer_module.test_ros2_robots import URDF


@pytest.fixture
def made(logic, node):
    """Makes nodes of a class in the scene, and removes them."""
    nodes = []

    def make(name):
        nodes.append(logic.AddNewNodeByClass(name))
        return nodes[-1]

    yield make
    for each in nodes:
        if each.IsAddedToROS2Node():
            assert each.RemoveFromROS2Node(node.GetID())
        logic.scene.RemoveNode(each)


def test_lookup_and_broadcaster_are_added_with_their_own_frames(made, node, spin_until):
    broadcaster = made("vtkMRMLROS2Tf2BroadcasterNode")
    lookup = made("vtkMRMLROS2Tf2LookupNode")
    for each in (broadcaster, lookup):
        assert not each.IsParentAndChildSet()
        assert each.AddToROS2Node(node.GetID()) is False
        assert (each.SetParentID("floor"), each.SetChildID("chair")) == (True, True)
        assert each.SetChildID("no frame") is False
        assert (each.GetParentID(), each.GetChildID()) == ("floor", "chair")
        assert each.IsParentAndChildSet()
        assert each.AddToROS2Node(node.GetID()) is True
        assert each.SetParentID("wall") is False  # it is added
    assert lookup.GetName() == "ros2:tf2lookup:floorTochair"
    assert node.GetTf2LookupNodeByParentChild("floor", "chair") is lookup
    pose = vtk.vtkMatrix4x4()
    pose.SetElement(2, 3, 40.0)

    def arrived():
        broadcaster.Broadcast(pose)
        return lookup.GetState() == "valid"

    spin_until(arrived)
    found = vtk.vtkMatrix4x4()
    lookup.GetMatrixTransformToParent(found)
    assert found.GetElement(2, 3) == pytest.approx(40.0)


def test_member_that_leaves_the_graph_stays_in_the_scene(made, node, caplog):
    publisher = made("vtkMRMLROS2PublisherStringNode")
    assert publisher.RemoveFromROS2Node(node.GetID(), "/news") is False
    assert publisher.AddToROS2Node(node.GetID(), "/news")
    assert publisher.RemoveFromROS2Node(node.GetID(), "/other") is False
    assert publisher.RemoveFromROS2Node("missing", "/news") is False
    assert node.GetPublisherNodeByTopic("/news") is publisher
    assert publisher.RemoveFromROS2Node(node.GetID(), "/news") is True
    assert node.GetPublisherNodeByTopic("/news") is None
    assert publisher.GetScene() is node.GetScene()
    assert publisher.AddToROS2Node(node.GetID(), "/other")


def test_messages_come_as_variant_and_into_output_arguments(made, node, spin_until):
    publisher, subscriber = (
        made(f"vtkMRMLROS2{role}DoubleNode") for role in ("Publisher", "Subscriber")
    )
    assert subscriber.GetBlankMessage() == 0.0
    number = vtk.reference(3.0)
    assert subscriber.GetLastMessage(number) is False
    assert number.get() == 3.0
    assert not subscriber.GetLastMessageVariant().IsValid()
    publisher.AddToROS2Node(node.GetID(), "/depth")
    subscriber.AddToROS2Node(node.GetID(), "/depth")

    def received():
        publisher.Publish(7.5)
        return subscriber.GetNumberOfMessages()

    spin_until(received)
    assert subscriber.GetLastMessage(number) is True
    assert number.get() == 7.5
    assert subscriber.GetLastMessageVariant().ToDouble() == 7.5
    with pytest.raises(MarginGuardError, match="output argument is list"):
        subscriber.GetLastMessage([])


def test_matrix_is_copied_into_an_output_argument(made, node, spin_until):
    publisher, subscriber = (
        made(f"vtkMRMLROS2{role}PoseNode") for role in ("Publisher", "Subscriber")
    )
    publisher.AddToROS2Node(node.GetID(), "/tip")
    subscriber.AddToROS2Node(node.GetID(), "/tip")
    pose, found = vtk.vtkMatrix4x4(), vtk.vtkMatrix4x4()
    pose.SetElement(0, 3, 12.0)

    def received():
        publisher.Publish(pose)
        return subscriber.GetNumberOfMessages()

    spin_until(received)
    assert subscriber.GetLastMessage(found) is True
    assert found.GetElement(0, 3) == pytest.approx(12.0)
    assert subscriber.GetLastMessageVariant().ToVTKObject().GetElement(0, 3) == found.GetElement(
        0, 3
    )


def test_parameters_come_into_output_arguments(node, peer, spin_until):
    parameters = node.CreateAndAddParameterNode("/peer")
    assert node.GetParameterNodeByNodeID(parameters.GetID()) is parameters
    parameters.AddParameter("count")
    spin_until(lambda: parameters.IsParameterSet("count"))
    number, text = vtk.reference(0), vtk.reference("")
    assert parameters.GetParameterAsInteger("count", number) is True
    assert number.get() == parameters.GetParameterAsInteger("count")
    assert parameters.GetParameterAsBool("count", number) is False  # of another type
    assert parameters.GetParameterAsInteger("missing", number) is False
    assert parameters.PrintParameterValue("count", text) is True
    assert (
        text.get() == parameters.PrintParameterValue("count") == parameters.PrintParameter("count")
    )
    assert node.RemoveAndDeleteParameterNodeByNodeID(parameters.GetID()) is True
    assert node.RemoveAndDeleteParameterNodeByNodeID(parameters.GetID()) is False


def test_service_client_tells_its_types_and_whether_it_may_send(
    logic, made, node, peer, wait_until
):
    absent, client = (made("vtkMRMLROS2ServiceClientSetBoolNode") for _ in range(2))
    assert absent.AddToROS2Node(node.GetID(), "/peer/absent")
    assert client.PreRequestCheck() is False
    client.AddToROS2Node(node.GetID(), "/peer/echo")
    assert node.GetServiceClientNodeByTopic("/peer/echo") is client
    assert client.GetSlicerTypeIn() == type(client.CreateBlankRequest()).__name__
    wait_until(client.PreRequestCheck)
    assert absent.PreRequestCheck() is False  # nothing serves it
    client.SendAsyncRequest({"data": True})
    assert client.PreRequestCheck() is False
    assert logic.WaitForServiceResponse(client, 10.0)
    assert client.GetSlicerTypeOut() == type(client.GetLastResponse()).__name__
    wait_until(client.PreRequestCheck)


def test_robot_is_added_with_the_name_set_before(logic, made, node, peer, spin_until):
    assert peer("set_parameter", name="robot_description", value=URDF, of="robot")
    robot = made("vtkMRMLROS2RobotNode")
    robot.SetRobotName("left")
    assert (robot.GetName(), robot.GetRobotName()) == ("ros2:robot:left", "left")
    assert robot.AddToROS2Node(node.GetID(), "/robot_state_publisher") is True
    with pytest.raises(MarginGuardError, match="before it is added"):
        robot.SetRobotName("right")
    assert node.GetRobotNodeByName("left") is robot
    spin_until(robot.GetLinkNames)
    assert robot.GetLinkNames()[0] == "base"


def test_spinning_is_known(node, caplog):
    caplog.set_level(logging.WARNING)
    node.Spin()
    assert node.GetSpinning() is True
    node.WarnIfNotSpinning("lookup")
    assert not caplog.records
