"""Goals from another process: every one ends, whatever our work does."""

import threading
from pathlib import Path

import pytest
from std_msgs.msg import String
from tf2_msgs.action import LookupTransform

from app.bridge.calls import ActionClient, ActionServer, CallError, GoalCancelledError, GoalOutcome
from app.bridge.node import RosNode
from app.geometry import InputError

SENDER = Path(__file__).resolve().parent / "goal_sender.py"
LOOKUP = "tf2_msgs/action/LookupTransform"


def work(served):
    how = served.request.source_frame
    result = LookupTransform.Result()
    result.transform.child_frame_id = how
    if how == "refuse":
        raise InputError("no such case")
    if how == "fail":
        raise ZeroDivisionError("of mine")
    if how == "nonsense":
        return String(data=3), GoalOutcome.SUCCEEDED
    if how == "wait":
        served.feedback(LookupTransform.Feedback())
        served.cancelled.wait(60.0)
        return result, GoalOutcome.CANCELLED
    return result, GoalOutcome.SUCCEEDED


def check(goal):
    if goal.source_frame == "reject":
        raise InputError("not this one")


@pytest.fixture
def server(ros):
    return ActionServer(ros, LOOKUP, "~/lookup", work, check=check)


def send(start_receiver, *goals):
    return start_receiver("/marginguard/lookup", LOOKUP, *goals, script=SENDER).messages()


def test_every_ending(server, start_receiver, capfd):
    hows = ("fine", "refuse", "fail", "nonsense", "reject")
    goals = [f'{{"source_frame": "{how}"}}' for how in hows]
    replies = send(start_receiver, *goals)
    assert [reply["status"] for reply in replies] == [
        "succeeded",
        "aborted",
        "aborted",
        "aborted",
        "rejected",
    ]
    assert replies[0]["result"]["transform"]["child_frame_id"] == "fine"
    assert (server.refused, server.failures, server.rejected) == (1, 2, 1)
    said = capfd.readouterr().err
    assert "goal rejected: not this one" in said
    assert "failed: ZeroDivisionError: of mine" in said


@pytest.mark.parametrize("after", [0, 1])
def test_cancelled_by_another_process(server, start_receiver, after):
    (reply,) = send(start_receiver, f'{{"source_frame": "wait", "cancel_after": {after}}}')
    assert reply["status"] == "cancelled"
    assert reply["result"]["transform"]["child_frame_id"] == "wait"


def test_one_goal_at_a_time_and_the_node_stays_responsive(server, ros, start_receiver):
    client = ActionClient(ros, LOOKUP, "~/lookup")
    first = client.start(LookupTransform.Goal(source_frame="wait"), 30.0)
    assert send(start_receiver, '{"source_frame": "fine"}') == [{"status": "rejected"}]
    first.cancel(30.0)
    with pytest.raises(GoalCancelledError):
        first.result(30.0)
    assert send(start_receiver, '{"source_frame": "fine"}')[0]["status"] == "succeeded"


def test_closing_the_node_ends_the_goal_and_sends_its_result(domain_id, start_receiver):
    # A caller asks for a goal's result after it has heard that the goal was taken: a node that
    # closes between the two has nobody to send it to. Then there is nothing to see: once more.
    for _ in range(5):
        reply = close_under_way(domain_id, start_receiver)
        if reply is not None:
            break
    # Nobody asked for the cancel by ROS's own way, so that "cancelled" is no ending of the goal.
    assert reply is not None
    assert reply["status"] == "aborted"


def close_under_way(domain_id, start_receiver):
    """What the sender of a goal got from a node that closed meanwhile; None when it got nothing."""
    ended, under_way = threading.Event(), threading.Event()

    def wait(served):
        served.on_cancel(ended.set)  # set again when the node closes
        served.feedback(LookupTransform.Feedback())
        under_way.set()
        served.cancelled.wait(60.0)
        return LookupTransform.Result(), GoalOutcome.CANCELLED

    with RosNode("marginguard", domain_id=domain_id) as ros:
        ActionServer(ros, LOOKUP, "~/lookup", wait)
        sender = start_receiver("/marginguard/lookup", LOOKUP, "{}", script=SENDER)
        assert under_way.wait(30.0)
    assert ended.is_set()
    try:
        (reply,) = sender.messages()
    except pytest.fail.Exception:
        return None
    return reply


def test_a_name_that_ros_refuses_is_one_line(ros):
    with pytest.raises(CallError, match="no action 'two words'") as caught:
        ActionServer(ros, LOOKUP, "two words", work)
    assert "\n" not in str(caught.value)
