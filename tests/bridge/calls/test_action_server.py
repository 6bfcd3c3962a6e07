"""Goals from another process: each ends with a result, even if its execution fails."""

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
    outcome = served.request.source_frame
    result = LookupTransform.Result()
    result.transform.child_frame_id = outcome
    if outcome == "refuse":
        raise InputError("no such case")
    if outcome == "fail":
        raise ZeroDivisionError("division failed")
    if outcome == "nonsense":
        return String(data=3), GoalOutcome.SUCCEEDED
    if outcome == "wait":
        served.feedback(LookupTransform.Feedback())
        served.cancelled.wait(60.0)
        return result, GoalOutcome.CANCELLED
    return result, GoalOutcome.SUCCEEDED


def check(goal):
    if goal.source_frame == "reject":
        raise InputError("not accepted")


@pytest.fixture
def server(ros):
    return ActionServer(ros, LOOKUP, "~/lookup", work, check=check)


def send(start_receiver, *goals):
    return start_receiver("/marginguard/lookup", LOOKUP, *goals, script=SENDER).messages()


def test_every_outcome_of_a_goal_is_reported(server, start_receiver, capfd):
    outcomes = ("fine", "refuse", "fail", "nonsense", "reject")
    goals = [f'{{"source_frame": "{outcome}"}}' for outcome in outcomes]
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
    log = capfd.readouterr().err
    assert "goal rejected: not accepted" in log
    assert "failed: ZeroDivisionError: division failed" in log


@pytest.mark.parametrize("after", [0, 1])
def test_goal_is_cancelled_by_another_process(server, start_receiver, after):
    (reply,) = send(start_receiver, f'{{"source_frame": "wait", "cancel_after": {after}}}')
    assert reply["status"] == "cancelled"
    assert reply["result"]["transform"]["child_frame_id"] == "wait"


def test_second_goal_is_rejected_and_node_stays_responsive(server, ros, start_receiver):
    client = ActionClient(ros, LOOKUP, "~/lookup")
    first = client.start(LookupTransform.Goal(source_frame="wait"), 30.0)
    assert send(start_receiver, '{"source_frame": "fine"}') == [{"status": "rejected"}]
    first.cancel(30.0)
    with pytest.raises(GoalCancelledError):
        first.result(30.0)
    assert send(start_receiver, '{"source_frame": "fine"}')[0]["status"] == "succeeded"


def test_closing_the_node_ends_the_goal_and_sends_its_result(domain_id, start_receiver):
    # A client requests the result after the goal is accepted. If the node closes in between, the
    # client gets no result, so try again.
    for _ in range(5):
        reply = close_during_goal(domain_id, start_receiver)
        if reply is not None:
            break
    # Without a cancel request ROS does not allow the outcome "cancelled".
    assert reply is not None
    assert reply["status"] == "aborted"


def close_during_goal(domain_id, start_receiver):
    """Reply to the sender of a goal when the node closes during it; None if it got none."""
    ended, active = threading.Event(), threading.Event()

    def wait(served):
        served.on_cancel(ended.set)  # called when the node closes
        served.feedback(LookupTransform.Feedback())
        active.set()
        served.cancelled.wait(60.0)
        return LookupTransform.Result(), GoalOutcome.CANCELLED

    with RosNode("marginguard", domain_id=domain_id) as ros:
        ActionServer(ros, LOOKUP, "~/lookup", wait)
        sender = start_receiver("/marginguard/lookup", LOOKUP, "{}", script=SENDER)
        assert active.wait(30.0)
    assert ended.is_set()
    try:
        (reply,) = sender.messages()
    except pytest.fail.Exception:
        return None
    return reply


def test_invalid_name_is_a_one_line_error(ros):
    with pytest.raises(CallError, match="action 'two words' cannot be served") as caught:
        ActionServer(ros, LOOKUP, "two words", work)
    assert "\n" not in str(caught.value)
