"""Service servers and action clients of the ROS2 module, which SlicerROS2 does not have."""

import threading

import pytest
from std_srvs.srv import SetBool

from app.geometry import MarginGuardError

LOOKUP = "tf2_msgs/action/LookupTransform"
SET_BOOL = "std_srvs/srv/SetBool"


@pytest.fixture
def ask(peer, spin_until):
    """Let the other process send a request and spin until it is answered."""

    def call(server, name, request):
        before = server.GetNumberOfRequests()
        peer.tell("call_service", name=name, type=SET_BOOL, request=request)
        spin_until(lambda: server.GetNumberOfRequests() > before or server.failed)
        return peer.answer()

    return call


def test_service_handler_runs_in_the_scenes_thread(node, ask):
    def answer(request, response):
        node.GetScene().AddNewNodeByClass("vtkMRMLTextNode", f"asked {request.GetData()}")
        response.SetSuccess(request.GetData())
        response.SetMessage("by the scene")

    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/ask", answer)
    server.failed = False
    assert server.GetName() == "ros2:srv:server:/scene/ask"
    assert (server.GetService(), server.GetROSType()) == ("/scene/ask", SET_BOOL)
    assert ask(server, "/scene/ask", {"data": True}) == {"success": True, "message": "by the scene"}
    text = node.GetScene().GetFirstNodeByName("asked True")
    node.GetScene().RemoveNode(text)
    assert node.GetServiceServerNodeByService("scene/ask") is server
    assert node.CreateAndAddServiceServerNode("Trigger", "/scene/ask", answer) is None
    assert node.RemoveAndDeleteServiceServerNode("/scene/ask") is True
    assert node.RemoveAndDeleteServiceServerNode("/scene/ask") is False


@pytest.mark.parametrize("wrong", ["raises", "fills in what does not fit"])
def test_failure_of_the_handler_is_reported_to_the_caller(node, ask, caplog, wrong):
    def answer(request, response):
        server.failed = True
        if wrong == "raises":
            raise ValueError("no tumour yet")
        response.SetMessage(5)

    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/fails", answer)
    server.failed = False
    reply = ask(server, "/scene/fails", {"data": True})
    assert reply["success"] is False
    assert ("no tumour yet" if wrong == "raises" else "expected a string") in reply["message"]
    assert "the handler failed" in caplog.text
    assert node.RemoveAndDeleteServiceServerNode("/scene/fails")


def test_pending_request_is_answered_when_the_service_is_removed(node, wait_until):
    server = node.CreateAndAddServiceServerNode("SetBool", "/scene/ends", lambda *_: None)
    told = []

    def ask():  # as the server's own thread does for each request
        try:
            server._answer(SetBool.Request(), SetBool.Response())
        except MarginGuardError as error:
            told.append(str(error))

    asking = threading.Thread(target=ask)
    asking.start()
    wait_until(lambda: server._pending is not None)
    assert node.RemoveAndDeleteServiceServerNode("/scene/ends")
    asking.join(10.0)
    assert told == ["the service has ended"]
    assert node.CreateAndAddServiceServerNode("SetBool", "/x", None) is None


def test_goal_delivers_feedback_and_result(node, spin_until):
    client = node.CreateAndAddActionClientNode(LOOKUP, "/peer/lookup")
    assert client.GetName() == "ros2:action:client:/peer/lookup"
    assert (client.GetAction(), client.GetROSType()) == ("/peer/lookup", LOOKUP)
    events = []
    client.AddObserver("ModifiedEvent", lambda *_: events.append(client.GetLastResultStatus()))
    goal = client.CreateBlankGoal()
    goal.SetSourceFrame("reach")
    client.SendAsyncGoal(goal)
    assert client.IsGoalInProgress()
    with pytest.raises(MarginGuardError, match="under way"):
        client.SendAsyncGoal(goal)
    spin_until(client.GetLastResultStatus)
    transform = client.GetLastResult().GetTransform()
    assert transform.GetChildFrameId() == "reach"
    assert transform.GetTransform().GetElement(0, 3) == 66.0
    assert client.GetLastFeedback() is not None
    assert events[-1] is True
    assert 1 <= len(events) <= 2
    assert node.RemoveAndDeleteActionClientNode("/peer/lookup")


@pytest.mark.parametrize(
    ("how", "words"), [("abort", "was aborted"), ("reject", "rejected"), ("crooked", "norm 0")]
)
def test_failed_goal_reports_its_reason(node, spin_until, how, words):
    client = node.CreateAndAddActionClientNode(LOOKUP, "/peer/lookup")
    client.SendAsyncGoal({"source_frame": how})
    spin_until(lambda: not client.IsGoalInProgress())
    assert client.GetLastResultStatus() is False
    assert words in client.GetLastError()
    assert (client.GetLastResult() is not None) == (how == "abort")
    assert node.RemoveAndDeleteActionClientNode("/peer/lookup")


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
