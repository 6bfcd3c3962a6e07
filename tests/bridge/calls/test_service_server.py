"""A service server replies to another process even when its handler fails."""

import threading

import pytest

from app.bridge.calls import CallError, ServiceClient, ServiceServer
from app.geometry import InputError
from tests.bridge.service_calls import CALLER
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow

TRIGGER = "std_srvs/srv/Trigger"


def test_server_replies_on_success_refusal_and_failure(ros, start_receiver, capfd):
    def good(_, response):
        response.success = True

    def refuses(_, response):
        response.success = True  # must not be in the reply
        raise InputError("rate is 0; expected 0.001 to 1000")

    def fails(_, response):
        raise ZeroDivisionError("of mine")

    def nonsense(_, response):
        response.message = 3

    servers = {
        handle.__name__: ServiceServer(ros, TRIGGER, f"~/{handle.__name__}", handle)
        for handle in (good, refuses, fails, nonsense)
    }
    names = [f"/marginguard/{name}:{TRIGGER}:{{}}" for name in servers]
    replies = start_receiver(*names, script=CALLER).messages()
    assert replies[:3] == [
        {"success": True, "message": ""},
        {"success": False, "message": "rate is 0; expected 0.001 to 1000"},
        {"success": False, "message": "the server failed: ZeroDivisionError: of mine"},
    ]
    assert not replies[3]["success"]
    assert "the server failed" in replies[3]["message"]
    assert [(each.refused, each.failures) for each in servers.values()] == [
        (0, 0),
        (1, 0),
        (0, 1),
        (0, 1),
    ]
    assert "/marginguard/fails failed: ZeroDivisionError" in capfd.readouterr().err


def test_slow_handler_in_thread_does_not_block_the_node(ros, peer):
    requested, proceed = threading.Event(), threading.Event()

    def slow(_, response):
        requested.set()
        proceed.wait(DEADLINE_S)
        response.success = True

    ServiceServer(ros, TRIGGER, "~/slow", slow, in_thread=True)
    client = ServiceClient(ros, TRIGGER, "~/slow")
    client.wait(DEADLINE_S)
    pending = client.start({})
    assert requested.wait(DEADLINE_S)
    # Meanwhile the node receives replies and refuses further requests.
    assert (
        ServiceClient(ros, "std_srvs/SetBool", "/peer/echo")
        .call({"data": True}, DEADLINE_S)
        .success
    )
    busy = client.call({}, DEADLINE_S)
    assert not busy.success
    assert "busy with an earlier request" in busy.message
    proceed.set()
    assert pending.result(DEADLINE_S).success
    assert client.call({}, DEADLINE_S).success


def test_invalid_name_is_a_one_line_error(ros):
    with pytest.raises(CallError, match="service 'two words' cannot be served") as caught:
        ServiceServer(ros, TRIGGER, "two words", lambda request, response: None)
    assert "\n" not in str(caught.value)
