"""Service servers and action clients of the ROS2 module, which SlicerROS2 does not have."""

import threading

import pytest
from std_srvs.srv import SetBool

from app.geometry import MarginGuardError
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

LOOKUP = "tf2_msgs/action/LookupTransform"
SET_BOOL = "std_srvs/srv/SetBool"


@pytest.fixture
def call_from_peer(peer, spin_until):
    """Make the peer process call a service; spin until the request has been handled."""

    def call(server, name, request):
        before = server.GetNumberOfRequests()
        peer.begin("call_service", name=name, type=SET_BOOL, request=request)
        spin_until(lambda: server.GetNumberOfRequests() > before or server.failed)
        return peer.result()

    return call


def test_service_handler_runs_in_the_scenes_thread(node, call_from_peer):
    def handle(request, response):
        node.GetScene().AddNewNodeByClass("vtkMRMLTextNode", f"called {request.GetData()}")
        response.SetSuccess(request.GetData())
        response.SetMessage("by the scene")

    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/call", handle)
    server.failed = False
    assert server.GetName() == "ros2:srv:server:/scene/call"
    assert (server.GetService(), server.GetROSType()) == ("/scene/call", SET_BOOL)
    reply = call_from_peer(server, "/scene/call", {"data": True})
    assert reply == {"success": True, "message": "by the scene"}
    text = node.GetScene().GetFirstNodeByName("called True")
    node.GetScene().RemoveNode(text)
    assert node.GetServiceServerNodeByService("scene/call") is server
    assert node.CreateAndAddServiceServerNode("Trigger", "/scene/call", handle) is None
    assert node.RemoveAndDeleteServiceServerNode("/scene/call") is True
    assert node.RemoveAndDeleteServiceServerNode("/scene/call") is False


@pytest.mark.parametrize("wrong", ["raises", "sets an invalid value"])
def test_failure_of_the_handler_is_reported_to_the_caller(node, call_from_peer, caplog, wrong):
    def handle(request, response):
        server.failed = True
        if wrong == "raises":
            raise ValueError("no tumour yet")
        response.SetMessage(5)

    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/fails", handle)
    server.failed = False
    reply = call_from_peer(server, "/scene/fails", {"data": True})
    assert reply["success"] is False
    assert ("no tumour yet" if wrong == "raises" else "expected a string") in reply["message"]
    assert "the handler failed" in caplog.text


def test_pending_request_is_answered_when_the_service_is_removed(node):
    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/ends", lambda *_: None)
    errors = []

    def request():  # like the server's thread for each request
        try:
            server._answer(SetBool.Request(), SetBool.Response())
        except MarginGuardError as error:
            errors.append(str(error))

    requesting = threading.Thread(target=request)
    requesting.start()
    wait_until(lambda: server._pending is not None)
    assert node.RemoveAndDeleteServiceServerNode("/scene/ends")
    requesting.join(DEADLINE_S)
    assert errors == ["the service has ended"]
    assert node.CreateAndAddServiceServerNode("SetBool", "/x", None) is None


def test_goal_delivers_feedback_and_result(node, spin_until):
    client = node.CreateAndAddActionClientNode(LOOKUP, "/peer/lookup")
    assert client.GetName() == "ros2:action:client:/peer/lookup"
    assert (client.GetAction(), client.GetROSType()) == ("/peer/lookup", LOOKUP)
    events = []
    client.AddObserver("ModifiedEvent", lambda *_: events.append(client.GetLastResultStatus()))
    goal = client.CreateBlankGoal()
    goal.SetSourceFrame("succeed")
    client.SendAsyncGoal(goal)
    assert client.IsGoalInProgress()
    with pytest.raises(MarginGuardError, match="under way"):
        client.SendAsyncGoal(goal)
    spin_until(client.GetLastResultStatus)
    transform = client.GetLastResult().GetTransform()
    assert transform.GetChildFrameId() == "succeed"
    assert transform.GetTransform().GetElement(0, 3) == 66.0
    assert client.GetLastFeedback() is not None
    assert events[-1] is True
    assert 1 <= len(events) <= 2


@pytest.mark.parametrize(
    ("how", "text"), [("abort", "was aborted"), ("reject", "rejected"), ("not_rigid", "norm 0")]
)
def test_failed_goal_reports_its_reason(node, spin_until, how, text):
    client = node.CreateAndAddActionClientNode(LOOKUP, "/peer/lookup")
    client.SendAsyncGoal({"source_frame": how})
    spin_until(lambda: not client.IsGoalInProgress())
    assert client.GetLastResultStatus() is False
    assert text in client.GetLastError()
    assert (client.GetLastResult() is not None) == (how == "abort")


def test_goal_is_cancelled_and_client_removed_while_it_runs(node, spin_until):
    client = node.CreateAndAddActionClientNode(LOOKUP, "/peer/lookup")
    assert client.CancelGoal() is False
    client.SendAsyncGoal({"source_frame": "cancel"})
    spin_until(lambda: client.GetLastFeedback() is not None)
    assert client.CancelGoal() is True
    spin_until(lambda: not client.IsGoalInProgress())
    assert "cancelled" in client.GetLastError()
    client.SendAsyncGoal({"source_frame": "cancel"})
    closers = len(node.ros._close_callbacks)
    assert node.RemoveAndDeleteActionClientNode("/peer/lookup") is True
    assert node.RemoveAndDeleteActionClientNode("/peer/lookup") is False
    assert len(node.ros._close_callbacks) == closers - 1
    with pytest.raises(MarginGuardError, match="not on a ROS node"):
        client.SendAsyncGoal({})
    for wrong in (0.0, float("nan")):
        with pytest.raises(MarginGuardError, match="timeout"):
            client.SetTimeoutSeconds(wrong)
    assert node.CreateAndAddActionClientNode("Nothing", "/x") is None
