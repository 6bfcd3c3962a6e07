"""Service clients of the ROS2 module against an rclpy process."""

import pytest

from app.geometry import MarginGuardError
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


def test_request_is_answered_with_one_event(node, peer, spin_until):
    client = node.CreateAndAddServiceClientNode("SetBool", "/peer/echo")
    assert client.GetName() == "ros2:srv:client:/peer/echo"
    assert (client.GetService(), client.GetROSType()) == ("/peer/echo", "std_srvs/srv/SetBool")
    events = []
    client.AddObserver("ModifiedEvent", lambda *_: events.append(client.GetLastResponse()))
    assert client.GetLastResponse() is None
    assert client.GetLastResponseStatus() is False
    for value in (True, False):
        request = client.CreateBlankRequest()
        assert request.GetData() is False
        request.SetData(value)
        assert client.SendAsyncRequest(request) == 1
        assert client.IsRequestInProgress()
        spin_until(client.GetLastResponseStatus)
        response = client.GetLastResponse()
        assert (response.GetSuccess(), response.GetMessage()) == (value, "echoed")
        assert client.GetLastError() == ""
    assert len(events) == 2
    assert (client.GetNumberOfCalls(), client.GetNumberOfRequestsSent()) == (2, 2)


def test_request_to_a_silent_server_times_out_without_blocking_others(logic, node, peer):
    silent = node.CreateAndAddServiceClientNode("Trigger", "/peer/no_reply")
    echo = node.CreateAndAddServiceClientNode("SetBoolString", "/peer/echo")
    silent.SetTimeoutSeconds(1.0)
    wait_until(silent.PreRequestCheck)  # its server is known
    events = []
    silent.AddObserver("ModifiedEvent", lambda *_: events.append(silent.GetLastError()))
    silent.SendAsyncRequest(silent.CreateBlankRequest())
    echo.SendAsyncRequest({"data": True})
    assert logic.WaitForServiceResponse(echo, DEADLINE_S) is True
    assert echo.GetLastResponse().GetSuccess() is True
    assert logic.WaitForServiceResponse(silent, DEADLINE_S) is False
    assert events == ["service /peer/no_reply: no reply within 1 s"]
    assert silent.GetLastResponse() is None
    assert not silent.IsRequestInProgress()
    # Removing a client ends its pending request.
    silent.SetTimeoutSeconds(60.0)
    silent.SendAsyncRequest(silent.CreateBlankRequest())
    assert node.RemoveAndDeleteServiceClientNode("/peer/no_reply")
    assert node.RemoveAndDeleteServiceClientNode("/peer/echo")
    peer("wait_until", call={"do": "clients_of", "name": "slicer"}, value=[])


def test_reply_that_cannot_be_converted_is_reported(logic, node, peer):
    client = node.CreateAndAddServiceClientNode("nav_msgs/srv/GetPlan", "/peer/not_rigid")
    events = []
    client.AddObserver("ModifiedEvent", lambda *_: events.append(client.GetLastError()))
    client.SendAsyncRequest({})
    assert logic.WaitForServiceResponse(client, DEADLINE_S) is False
    assert len(events) == 1
    assert "norm 0" in client.GetLastError()


def test_missing_server_is_reported(logic, node):
    client = node.CreateAndAddServiceClientNode("Trigger", "/missing")
    client.SetTimeoutSeconds(0.1)
    responses = []
    client.AddObserver(client.ResponseReceivedEvent, lambda *_: responses.append(1))
    client.SendAsyncRequest({})
    assert logic.WaitForServiceResponse(client, DEADLINE_S) is False
    assert responses == []
    assert client.GetLastError() == "service /missing: no server found within 0.1 s"


def test_second_request_while_one_is_under_way_is_not_sent(logic, node, peer):
    client = node.CreateAndAddServiceClientNode("SetBool", "/peer/echo")
    assert [client.SendAsyncRequest({"data": value}) for value in (True, False)] == [1, 0]
    assert logic.WaitForServiceResponse(client, DEADLINE_S)
    assert client.GetLastResponse().GetSuccess() is True
    assert (client.GetNumberOfCalls(), client.GetNumberOfRequestsSent()) == (2, 1)
    assert client.SendAsyncRequest({"data": False}) == 1


def test_invalid_request_is_not_sent(node):
    client = node.CreateAndAddServiceClientNode("vtkMRMLROS2ServiceClientSetBoolNode", "/x")
    assert client.GetClassName() == "vtkMRMLROS2ServiceClientSetBoolNode"
    other = node.CreateAndAddServiceClientNode("std_srvs/srv/Trigger", "/y").CreateBlankRequest()
    for wrong in ({"data": 3}, {"no": 1}, other, 5):
        with pytest.raises(MarginGuardError):
            client.SendAsyncRequest(wrong)
    assert client.GetNumberOfRequestsSent() == 0
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(MarginGuardError, match="timeout"):
            client.SetTimeoutSeconds(wrong)
    assert node.RemoveAndDeleteServiceClientNode("/x")
    assert node.RemoveAndDeleteServiceClientNode("/y")
    assert client.SendAsyncRequest({"data": True}) == 0


def test_messages_of_set_bool_string_have_its_accessors(logic, node, peer):
    client = node.CreateAndAddServiceClientNode("SetBoolString", "/peer/echo")
    assert (client.GetSlicerTypeIn(), client.GetSlicerTypeOut()) == ("vtkBoolString",) * 2
    events = []
    client.AddObserver(1054, lambda *_: events.append(client.GetLastResponse().GetMessage()))
    request = client.CreateBlankRequest()
    request.SetResult(True)
    request.SetMessage("kept in the scene")
    assert (request.GetResult(), request.GetData()) == (True, True)
    assert request.GetMessage() == "kept in the scene"
    assert client.SendAsyncRequest(request) == 1
    assert logic.WaitForServiceResponse(client, DEADLINE_S)
    response = client.GetLastResponse()
    assert (response.GetResult(), response.GetSuccess()) == (True, True)
    assert (response.GetMessage(), response.GetClassName()) == ("echoed", "vtkBoolString")
    assert events == ["echoed"]
    assert client.ServiceModifiedEvent == client.ResponseReceivedEvent == 1054


def test_service_client_is_unique_per_service_and_removable(node, caplog):
    before = node.GetScene().GetNumberOfNodes()
    client = node.CreateAndAddServiceClientNode("Trigger", "/z")
    assert node.GetServiceClientNodeByService("z") is client
    assert node.CreateAndAddServiceClientNode("Trigger", "z") is None
    assert node.CreateAndAddServiceClientNode("Nothing", "/w") is None
    # A type that is not installed is logged and gives None.
    assert node.CreateAndAddServiceClientNode("absent_msgs/srv/GetPositionFK", "/fk") is None
    assert "absent_msgs" in caplog.text
    assert node.RemoveAndDeleteServiceClientNode("/z") is True
    assert node.RemoveAndDeleteServiceClientNode("/z") is False
    assert node.RemoveAndDeleteServiceClientNode("/never") is False
    assert node.GetScene().GetNumberOfNodes() == before
    names = node.RegisteredROS2ServiceClientNodes().split("\n")
    assert {"vtkMRMLROS2ServiceClientSetBoolStringNode", "vtkMRMLROS2ServiceClientSpawnNode"} <= {
        *names
    }
