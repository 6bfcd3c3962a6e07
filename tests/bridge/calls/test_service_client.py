"""A call to another process ends with its reply or with an error."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from std_srvs.srv import SetBool, Trigger

from app.bridge.calls import (
    CallCancelledError,
    CallError,
    CallTimeoutError,
    ServerGoneError,
    ServerUnavailableError,
    ServiceClient,
    ServiceServer,
)
from app.bridge.convert import ConversionError, UnknownTypeError
from app.bridge.node import RosNode
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

TRIGGER = "std_srvs/srv/Trigger"


@pytest.fixture
def slow(ros, peer):
    client = ServiceClient(ros, TRIGGER, "/peer/slow")
    client.wait(DEADLINE_S)
    return client


def test_call_returns_the_reply_of_another_process(ros, peer):
    echo = ServiceClient(ros, "std_srvs/SetBool", "/peer/echo")
    for value in (True, False):
        reply = echo.call(SetBool.Request(data=value), timeout_s=DEADLINE_S, repeat_s=1.0)
        assert (reply.success, reply.message) == (value, "echoed")


def test_plain_values_are_checked_and_sent(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    assert echo.call({"data": True}, timeout_s=DEADLINE_S, repeat_s=1.0).success
    with pytest.raises(
        ConversionError, match=r"SetBool_Request\.data is 1; expected true or false"
    ):
        echo.call({"data": 1}, timeout_s=DEADLINE_S)


def test_started_call_passes_its_reply_to_a_callback(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    echo.wait(DEADLINE_S)
    replies, arrived = [], threading.Event()
    echo.call({}, timeout_s=DEADLINE_S, repeat_s=1.0)  # afterwards both have discovered each other
    pending = echo.start(SetBool.Request(data=True))
    pending.when_done(lambda reply: (replies.append(reply), arrived.set()))
    assert pending.result(DEADLINE_S).success
    assert arrived.wait(DEADLINE_S)
    assert replies[0] is pending.result(0.0)


def test_reply_is_kept_in_a_burst_of_replies_to_another_client(ros, domain_id):
    taking, proceed = threading.Event(), threading.Event()
    with RosNode("server", domain_id=domain_id) as server, RosNode("b", domain_id=domain_id) as b:
        served = threading.Event()

        def serve(request, response):
            response.success = True
            if request.data:
                served.set()

        ServiceServer(server, SetBool, "/burst", serve, max_waiting=100)
        mine, other = ServiceClient(ros, SetBool, "/burst"), ServiceClient(b, SetBool, "/burst")
        for client in (mine, other):
            assert client.call({}, timeout_s=DEADLINE_S, repeat_s=1.0).success
        ros.call_soon(lambda: (taking.set(), proceed.wait(DEADLINE_S)))
        assert taking.wait(DEADLINE_S)
        pending = mine.start({"data": True})
        assert served.wait(DEADLINE_S)
        for _ in range(50):
            other.call({}, timeout_s=DEADLINE_S)
        proceed.set()
        assert pending.result(DEADLINE_S).success


def test_missing_server_raises(ros):
    with pytest.raises(ServerUnavailableError, match=r"/missing: no server found within 0.05 s"):
        ServiceClient(ros, TRIGGER, "/missing").call(Trigger.Request(), timeout_s=0.05)


def test_late_reply_is_logged(slow, ros, peer, capfd):
    with pytest.raises(CallTimeoutError, match=r"/peer/slow: no reply within 0\.\d+ s"):
        slow.call(Trigger.Request(), timeout_s=0.2)
    assert peer.take(1) == [{"slow": "waits"}]
    again = slow.start(Trigger.Request())
    ServiceClient(ros, TRIGGER, "/peer/go").call({}, timeout_s=DEADLINE_S, repeat_s=1.0)
    assert again.result(DEADLINE_S).message == "at last"
    late, log = "a reply arrived after the caller's timeout", ""
    for _ in range(100):  # the threads of the other process reply in any order
        log += capfd.readouterr().err
        if late in log:
            break
        slow.call(Trigger.Request(), timeout_s=DEADLINE_S)
    assert log.count(late) == 1


def test_call_is_cancelled_from_another_thread(slow, peer):
    cancel = threading.Event()
    with ThreadPoolExecutor() as workers:
        call = workers.submit(slow.call, Trigger.Request(), timeout_s=DEADLINE_S, cancel=cancel)
        peer.take(1)
        cancel.set()
        with pytest.raises(CallCancelledError, match=r"^service /peer/slow was cancelled by the"):
            call.result(DEADLINE_S)


def test_cancelled_call_does_not_call_back(slow, ros, peer):
    replies = []
    pending = slow.start(Trigger.Request())
    pending.when_done(replies.append)
    pending.cancel()
    with pytest.raises(CallCancelledError):
        pending.result(1.0)
    ServiceClient(ros, TRIGGER, "/peer/go").call({}, timeout_s=DEADLINE_S, repeat_s=1.0)
    slow.call(Trigger.Request(), timeout_s=DEADLINE_S)
    assert replies == []


def test_killed_server_ends_the_call(ros, peer):
    leave = ServiceClient(ros, TRIGGER, "/peer/leave")
    leave.wait(DEADLINE_S)
    # A killed server counts as available until its discovery lease expires.
    with pytest.raises((ServerGoneError, CallTimeoutError)):
        leave.call(Trigger.Request(), timeout_s=1.0)


def test_destroyed_server_is_detected_at_once(ros, domain_id):
    requested, proceed = threading.Event(), threading.Event()
    with RosNode("other", domain_id=domain_id) as other:

        def hang(_, response):
            requested.set()
            proceed.wait(DEADLINE_S)
            return response

        service = other.node.create_service(Trigger, "/other/hang", hang)
        client = ServiceClient(ros, TRIGGER, "/other/hang")
        client.wait(DEADLINE_S)
        pending = client.start(Trigger.Request())
        assert requested.wait(DEADLINE_S)
        other.node.destroy_service(service)
        proceed.set()
        with pytest.raises((ServerGoneError, CallTimeoutError)) as caught:
            pending.result(DEADLINE_S)
    assert isinstance(caught.value, ServerGoneError)


def test_call_in_the_nodes_own_thread_is_refused(ros, peer):
    echo = ServiceClient(ros, SetBool, "/peer/echo")
    echo.wait(DEADLINE_S)
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
    assert "would block the node's thread" in refused[0]


def test_call_on_a_closed_node_is_refused(domain_id):
    ros = RosNode("brief", domain_id=domain_id)
    client = ServiceClient(ros, TRIGGER, "/missing")
    ros.close()
    with pytest.raises(CallError, match="the node is closed"):
        client.call(Trigger.Request(), timeout_s=DEADLINE_S)


@pytest.mark.parametrize(
    "name", ["std_srvs/srv/Nothing", "no_such_package/Trigger", "Trigger", "a/b/c/d", "os/path/x"]
)
def test_unknown_type_is_refused_with_its_name(ros, name):
    with pytest.raises(UnknownTypeError, match=name):
        ServiceClient(ros, name, "/x")


@pytest.mark.parametrize("name", ["", "two words", "/ends/"])
def test_invalid_name_is_a_one_line_error(ros, name):
    with pytest.raises(CallError, match="no client for a service") as caught:
        ServiceClient(ros, TRIGGER, name)
    assert "\n" not in str(caught.value)


def test_request_of_wrong_type_is_refused(ros):
    with pytest.raises(CallError, match=r"is a SetBool_Request; expected Trigger.Request"):
        ServiceClient(ros, TRIGGER, "/x").start(SetBool.Request())


def test_abandoned_calls_are_limited(slow):
    for _ in range(150):
        slow.start(Trigger.Request()).cancel()
    assert len(slow._abandoned) == 100


def test_closed_client_sends_nothing(ros, peer):
    client = ServiceClient(ros, "std_srvs/srv/SetBool", "/peer/echo")
    client.wait(DEADLINE_S)
    client.close()
    client.close()
    assert not client.is_available
    with pytest.raises(CallError, match="/peer/echo: the client is closed"):
        client.start({"data": True})
