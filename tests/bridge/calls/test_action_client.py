"""Goals sent to another process, with every outcome."""

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
from std_srvs.srv import Trigger
from tf2_msgs.action import LookupTransform

from app.bridge.calls import (
    ActionClient,
    CallCancelledError,
    CallError,
    CallTimeoutError,
    GoalAbortedError,
    GoalCancelledError,
    GoalRejectedError,
    RefusedError,
    ServerUnavailableError,
    ServiceClient,
)
from app.bridge.convert import UnknownTypeError
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

LOOKUP = "tf2_msgs/action/LookupTransform"


@pytest.fixture
def lookup(ros, peer):
    client = ActionClient(ros, LOOKUP, "/peer/lookup")
    client.wait(DEADLINE_S)
    assert peer.take(1) == [{"lookup": "found"}]
    return client


def goal(outcome):
    return LookupTransform.Goal(source_frame=outcome)


def test_goal_gets_result_and_feedback(lookup):
    feedback = []
    result = lookup.call(goal("fine"), 30.0, feedback=feedback.append)
    assert result.transform.child_frame_id == "fine"
    assert all(isinstance(each, LookupTransform.Feedback) for each in feedback)


def test_rejected_aborted_and_cancelled_goals_raise(lookup, peer):
    with pytest.raises(GoalRejectedError, match="/peer/lookup"):
        lookup.start(goal("reject"), DEADLINE_S)
    with pytest.raises(GoalAbortedError) as aborted:
        lookup.call(goal("abort"), DEADLINE_S)
    assert aborted.value.result.transform.child_frame_id == "abort"
    started = lookup.start(goal("cancel"), DEADLINE_S)
    assert peer.take(1) == [{"goal": "waits"}]
    assert not started.is_done
    started.cancel(DEADLINE_S)
    with pytest.raises(GoalCancelledError) as cancelled:
        started.result(DEADLINE_S)
    assert cancelled.value.result.transform.child_frame_id == "cancel"
    assert peer.take(1) == [{"goal": "cancelled"}]


class Slow(dict):
    """Replaces rclpy's table of requests; looking up a request takes 0.3 s."""

    def __contains__(self, key):
        threading.Event().wait(0.3)
        return super().__contains__(key)


@pytest.mark.parametrize("requests", ["_pending_goal_requests", "_pending_result_requests"])
def test_reply_faster_than_its_registration_is_not_lost(lookup, requests):
    # Sent from another thread, the reply would arrive before the request is registered.
    setattr(lookup._client, requests, Slow())
    assert lookup.call(goal("fine"), DEADLINE_S).transform.child_frame_id == "fine"


@contextmanager
def waiting_call(lookup, peer, error, *cancel):
    """A call in another thread, which the body of the ``with`` block ends with ``error``."""
    with ThreadPoolExecutor() as workers:
        call = workers.submit(lookup.call, goal("cancel"), DEADLINE_S, *cancel)
        assert peer.take(1) == [{"goal": "waits"}]
        yield
        with pytest.raises(error):
            call.result(DEADLINE_S)


def test_closing_the_node_ends_a_call_with_a_reason(ros, lookup, peer):
    with waiting_call(lookup, peer, CallError):
        ros.close()
    with pytest.raises(CallError, match="the node is closed"):
        lookup.start(goal("fine"), 1.0)


def test_goal_is_cancelled_when_its_caller_times_out(lookup, peer):
    with pytest.raises(CallTimeoutError):
        lookup.call(goal("cancel"), 0.5)
    assert peer.take(2) == [{"goal": "waits"}, {"goal": "cancelled"}]


def test_call_is_cancelled_from_another_thread(lookup, peer):
    cancel = threading.Event()
    with waiting_call(lookup, peer, CallCancelledError, cancel):
        cancel.set()
    assert peer.take(1) == [{"goal": "cancelled"}]


def test_server_can_refuse_to_cancel(lookup, ros):
    started = lookup.start(goal("stubborn"), DEADLINE_S)
    with pytest.raises(RefusedError, match="the server refused to cancel the goal"):
        started.cancel(DEADLINE_S)
    ServiceClient(ros, Trigger, "/peer/go").call({}, timeout_s=DEADLINE_S, repeat_s=1.0)
    assert started.result(DEADLINE_S).transform.child_frame_id == "stubborn"
    started.cancel()  # the goal has already ended


def test_missing_server_and_invalid_names_are_errors(ros):
    with pytest.raises(ServerUnavailableError, match="action /missing: no server found"):
        ActionClient(ros, LOOKUP, "/missing").call(goal("x"), 0.05)
    with pytest.raises(UnknownTypeError, match="NoAction"):
        ActionClient(ros, "tf2_msgs/action/NoAction", "/x")
    with pytest.raises(CallError, match="no client for an action"):
        ActionClient(ros, LOOKUP, "two words")
    with pytest.raises(
        CallError, match=r"is a LookupTransform_Result; expected LookupTransform.Goal"
    ):
        ActionClient(ros, LOOKUP, "/x").start(LookupTransform.Result())
