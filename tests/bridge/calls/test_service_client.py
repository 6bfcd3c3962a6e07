"""A call to another process ends with its reply, or with the reason why there is none."""

import threading

import pytest
from std_srvs.srv import SetBool, Trigger

from app.bridge.calls import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    ServerGoneError,
    ServerUnavailableError,
    ServiceClient,
)
from app.bridge.convert import ConversionError, UnknownTypeError

TRIGGER = "std_srvs/srv/Trigger"


def test_replies_of_another_process(ros, peer):
    echo = ServiceClient(ros, "std_srvs/SetBool", "/peer/echo")
    for wanted in (True, False):
        reply = echo.call(SetBool.Request(data=wanted), timeout_s=30.0, repeat_s=1.0)
        assert (reply.success, reply.message) == (wanted, "echoed")


def test_plain_values_are_checked_and_sent(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    assert echo.call({"data": True}, timeout_s=30.0, repeat_s=1.0).success
    with pytest.raises(ConversionError, match=r"SetBool_Request\.data is 1: true or false"):
        echo.call({"data": 1}, timeout_s=30.0)


def test_a_started_call_gives_its_reply_to_a_callback(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    echo.wait(30.0)
    taken, arrived = [], threading.Event()
    echo.call({}, timeout_s=30.0, repeat_s=1.0)  # from here on both know each other
    pending = echo.start(SetBool.Request(data=True))
    pending.when_done(lambda reply: (taken.append(reply), arrived.set()))
    assert pending.result(30.0).success
    assert arrived.wait(30.0)
    assert taken[0] is pending.result(0.0)


def test_nobody_there(ros):
    with pytest.raises(ServerUnavailableError, match=r"/nobody.*waited 0.05 s"):
        ServiceClient(ros, TRIGGER, "/nobody").call(Trigger.Request(), timeout_s=0.05)


def test_a_reply_after_the_timeout_is_counted_and_said(ros, peer, capfd):
    slow = ServiceClient(ros, TRIGGER, "/peer/slow")
    slow.wait(30.0)
    with pytest.raises(CallTimeoutError, match=r"/peer/slow: no reply within 0\.\d+ s"):
        slow.call(Trigger.Request(), timeout_s=0.2)
    assert peer.take(1) == [{"slow": "waits"}]
    again = slow.start(Trigger.Request())
    ServiceClient(ros, TRIGGER, "/peer/go").call({}, timeout_s=30.0, repeat_s=1.0)
    assert again.result(30.0).message == "at last"
    for _ in range(100):  # the threads of the other process answer in any order
        if slow.late_replies:
            break
        slow.call(Trigger.Request(), timeout_s=30.0)
    assert slow.late_replies == 1
    assert "a reply came after its caller had given up" in capfd.readouterr().err


def test_a_wait_is_cancelled_from_another_thread(ros, peer):
    slow = ServiceClient(ros, TRIGGER, "/peer/slow")
    slow.wait(30.0)
    cancel = threading.Event()
    ended = []

    def call():
        try:
            slow.call(Trigger.Request(), timeout_s=60.0, cancel=cancel)
        except CallCancelledError as error:
            ended.append(str(error))

    caller = threading.Thread(target=call)
    caller.start()
    peer.take(1)
    cancel.set()
    caller.join(30.0)
    assert ended == ["service /peer/slow was cancelled by the caller"]


def test_a_cancelled_call_calls_nobody_back(ros, peer):
    slow = ServiceClient(ros, TRIGGER, "/peer/slow")
    slow.wait(30.0)
    taken = []
    pending = slow.start(Trigger.Request())
    pending.when_done(taken.append)
    pending.cancel()
    with pytest.raises(CallCancelledError):
        pending.result(1.0)
    ServiceClient(ros, TRIGGER, "/peer/go").call({}, timeout_s=30.0, repeat_s=1.0)
    slow.call(Trigger.Request(), timeout_s=30.0)
    assert taken == []


def test_a_server_that_leaves_in_the_middle(ros, peer):
    leave = ServiceClient(ros, TRIGGER, "/peer/leave")
    leave.wait(30.0)
    # It dies without a word: until the discovery's lease runs out it counts as there.
    with pytest.raises((ServerGoneError, CallTimeoutError)):
        leave.call(Trigger.Request(), timeout_s=1.0)


def test_a_server_that_says_goodbye_is_missed_at_once(ros, domain_id):
    from app.bridge.node import RosNode

    asked, answer = threading.Event(), threading.Event()
    with RosNode("other", domain_id=domain_id) as other:

        def hang(_, response):
            asked.set()
            answer.wait(60.0)
            return response

        service = other.node.create_service(Trigger, "/other/hang", hang)
        client = ServiceClient(ros, TRIGGER, "/other/hang")
        client.wait(30.0)
        pending = client.start(Trigger.Request())
        assert asked.wait(30.0)
        other.node.destroy_service(service)
        answer.set()
        with pytest.raises((ServerGoneError, CallTimeoutError)) as caught:
            pending.result(30.0)
    assert isinstance(caught.value, ServerGoneError)


def test_waiting_in_the_nodes_own_thread_is_refused(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    echo.wait(30.0)
    refused, done = [], threading.Event()

    def inside(_):
        try:
            echo.call(SetBool.Request(), timeout_s=1.0)
        except CallError as error:
            refused.append(str(error))
        done.set()

    for _ in range(30):  # until the other process has discovered us and its reply arrives
        echo.start(SetBool.Request()).when_done(inside)
        if done.wait(1.0):
            break
    assert "the node's own thread" in refused[0]


def test_a_closed_node_ends_the_wait(domain_id):
    from app.bridge.node import RosNode

    ros = RosNode("brief", domain_id=domain_id)
    client = ServiceClient(ros, TRIGGER, "/nobody")
    ros.close()
    with pytest.raises(CallError, match="the node is closed"):
        client.call(Trigger.Request(), timeout_s=60.0)


@pytest.mark.parametrize(
    "name", ["std_srvs/srv/Nothing", "no_such_package/Trigger", "Trigger", "a/b/c/d", "os/path/x"]
)
def test_an_unknown_type_is_named(ros, name):
    with pytest.raises(UnknownTypeError, match=name):
        ServiceClient(ros, name, "/x")


@pytest.mark.parametrize("name", ["", "two words", "/ends/"])
def test_a_name_that_ros_refuses_is_one_line(ros, name):
    with pytest.raises(CallError, match="no client for a service") as caught:
        ServiceClient(ros, TRIGGER, name)
    assert "\n" not in str(caught.value)


def test_a_request_of_another_type_is_refused(ros):
    with pytest.raises(CallError, match="SetBool_Request is no request of Trigger"):
        ServiceClient(ros, TRIGGER, "/x").start(SetBool.Request())


def test_what_never_comes_is_forgotten_in_the_end(ros, peer):
    slow = ServiceClient(ros, TRIGGER, "/peer/slow")
    slow.wait(30.0)
    for _ in range(150):
        slow.start(Trigger.Request()).cancel()
    assert slow.forgotten == 50


def test_a_closed_client_asks_nobody(ros, peer):
    client = ServiceClient(ros, "std_srvs/srv/SetBool", "/peer/echo")
    client.wait(30.0)
    client.close()
    client.close()
    assert not client.is_available
    with pytest.raises(CallError, match="/peer/echo: the client is closed"):
        client.start({"data": True})
