"""Goals from another process: each ends with a result, even if its execution fails."""

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.action.client import ActionClient as RosActionClient
from std_msgs.msg import String
from tf2_msgs.action import LookupTransform

from app.bridge.calls import ActionClient, ActionServer, CallError, GoalCancelledError, GoalOutcome
from app.bridge.node import RosNode
from app.bridge.topics import LATCHED, Topic
from app.geometry import NS_PER_S, InputError
from tests.bridge.nodes import ros_nodes
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

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
        served.cancelled.wait(DEADLINE_S)
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
    assert (server.refused, server.failures) == (1, 2)
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
    first = client.start(LookupTransform.Goal(source_frame="wait"), DEADLINE_S)
    assert send(start_receiver, '{"source_frame": "fine"}') == [{"status": "rejected"}]
    first.cancel(DEADLINE_S)
    with pytest.raises(GoalCancelledError):
        first.result(DEADLINE_S)
    assert send(start_receiver, '{"source_frame": "fine"}')[0]["status"] == "succeeded"


@pytest.fixture
def until_cancelled(domain_id):
    """A server whose goal ends when the node closes, and two events: goal active, goal ended."""
    active, ended = threading.Event(), threading.Event()

    def wait(served):
        active.set()
        served.cancelled.wait(DEADLINE_S)
        return LookupTransform.Result(), GoalOutcome.CANCELLED

    def on_statuses(message):
        # The empty list of a closing server can replace the status before it is read.
        statuses = [each.status for each in message.status_list]
        if active.is_set() and (not statuses or GoalStatus.STATUS_ABORTED in statuses):
            ended.set()

    statuses = Topic("/marginguard/lookup/_action/status", GoalStatusArray, LATCHED)
    with ros_nodes(domain_id, "observer", "marginguard") as (observer, ros):
        observer.subscribe(statuses, on_statuses)
        ActionServer(ros, LOOKUP, "~/lookup", wait)
        yield ros, active, ended


def test_closing_node_waits_for_client_to_receive_result(
    until_cancelled, start_receiver, monkeypatch
):
    monkeypatch.setattr("app.bridge.node._FLUSH_TIMEOUT_NS", 30 * NS_PER_S)
    monkeypatch.setattr("app.bridge.calls.action_server._REQUEST_TIMEOUT_S", 60.0)
    ros, active, ended = until_cancelled
    sender = start_receiver("/marginguard/lookup", LOOKUP, "{}", script=SENDER)
    assert active.wait(DEADLINE_S)
    with ThreadPoolExecutor() as workers:
        with sender.held():
            closed = workers.submit(ros.close)
            assert ended.wait(DEADLINE_S)
            with pytest.raises(TimeoutError):  # the client is suspended
                closed.result(0.3)
        closed.result(DEADLINE_S)
    # Without a cancel request ROS does not allow the outcome "cancelled".
    assert [reply["status"] for reply in sender.messages()] == ["aborted"]


def test_closing_node_sends_result_that_is_requested_after_the_end(
    until_cancelled, domain_id, monkeypatch
):
    monkeypatch.setattr("app.bridge.calls.action_server._REQUEST_TIMEOUT_S", 60.0)
    ros, active, ended = until_cancelled
    with RosNode("sender", domain_id=domain_id) as sending, ThreadPoolExecutor() as workers:
        client = RosActionClient(sending.node, LookupTransform, "/marginguard/lookup")
        assert client.wait_for_server(DEADLINE_S)
        handle = reply_of(client.send_goal_async(LookupTransform.Goal()))
        assert active.wait(DEADLINE_S)
        closed = workers.submit(ros.close)
        assert ended.wait(DEADLINE_S)
        with pytest.raises(TimeoutError):
            closed.result(0.3)
        assert reply_of(handle.get_result_async()).status == GoalStatus.STATUS_ABORTED
        closed.result(DEADLINE_S)


def test_closing_node_does_not_wait_forever_for_request_of_result(
    until_cancelled, domain_id, monkeypatch
):
    monkeypatch.setattr("app.bridge.calls.action_server._REQUEST_TIMEOUT_S", 0.1)
    ros, active, _ = until_cancelled
    with RosNode("sender", domain_id=domain_id) as sending:
        client = RosActionClient(sending.node, LookupTransform, "/marginguard/lookup")
        assert client.wait_for_server(DEADLINE_S)
        reply_of(client.send_goal_async(LookupTransform.Goal()))
        assert active.wait(DEADLINE_S)
        ros.close()
        assert not ros.is_open


def reply_of(future):
    """The result of a future that another thread completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(DEADLINE_S)
    return future.result()


def test_invalid_name_is_a_one_line_error(ros):
    with pytest.raises(CallError, match="action 'two words' cannot be served") as caught:
        ActionServer(ros, LOOKUP, "two words", work)
    assert "\n" not in str(caught.value)
