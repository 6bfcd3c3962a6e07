"""Calls of SlicerROS2 below its helper methods: nodes that a script makes and adds by itself."""

import pytest
import vtk

from app.geometry import MarginGuardError
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


@pytest.fixture
def made(logic):
    """``made(name)``: a new node of a class in the scene."""
    return logic.AddNewNodeByClass


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


def test_parameters_come_into_output_arguments(node, peer, spin_until):
    parameters = node.CreateAndAddParameterNode("/peer")
    assert node.GetParameterNodeByNodeID(parameters.GetID()) is parameters
    parameters.AddParameter("count")
    spin_until(lambda: parameters.IsParameterSet("count"))
    number, text = vtk.reference(0), vtk.reference("")
    assert parameters.GetParameterAsBool("count", number) is False  # of another type
    assert parameters.PrintParameterValue("count", text) is True
    assert (
        text.get() == parameters.PrintParameterValue("count") == parameters.PrintParameter("count")
    )
    assert node.RemoveAndDeleteParameterNodeByNodeID(parameters.GetID()) is True
    assert node.RemoveAndDeleteParameterNodeByNodeID(parameters.GetID()) is False


def test_service_client_tells_its_types_and_whether_it_may_send(logic, made, node, peer):
    absent, client = (made("vtkMRMLROS2ServiceClientSetBoolNode") for _ in range(2))
    assert absent.AddToROS2Node(node.GetID(), "/peer/absent")
    assert absent.IsAddedToROS2Node()
    assert client.PreRequestCheck() is False
    client.AddToROS2Node(node.GetID(), "/peer/echo")
    assert node.GetServiceClientNodeByTopic("/peer/echo") is client
    assert client.GetSlicerTypeIn() == type(client.CreateBlankRequest()).__name__
    wait_until(client.PreRequestCheck)
    assert absent.PreRequestCheck() is False  # nothing serves it
    assert absent.RemoveFromROS2Node(node.GetID())
    client.SendAsyncRequest({"data": True})
    assert client.PreRequestCheck() is False
    assert logic.WaitForServiceResponse(client, DEADLINE_S)
    assert client.GetSlicerTypeOut() == type(client.GetLastResponse()).__name__
    wait_until(client.PreRequestCheck)


def test_robot_is_added_with_the_name_set_before(made, node, describe, spin_until):
    robot = made("vtkMRMLROS2RobotNode")
    robot.SetRobotName("left")
    assert (robot.GetName(), robot.GetRobotName()) == ("ros2:robot:left", "left")
    assert robot.AddToROS2Node(node.GetID(), "/robot_state_publisher") is True
    with pytest.raises(MarginGuardError, match="before it is added"):
        robot.SetRobotName("right")
    assert node.GetRobotNodeByName("left") is robot
    spin_until(robot.GetLinkNames)
    assert robot.GetLinkNames()[0] == "base"
