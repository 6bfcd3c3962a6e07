"""Whatever a handler does, the other process gets an answer."""

import threading
from pathlib import Path

import pytest

from app.bridge.calls import CallError, ServiceClient, ServiceServer
from app.geometry import InputError

CALLER = Path(__file__).resolve().parents[1] / "caller.py"
TRIGGER = "std_srvs/srv/Trigger"


def test_answers_refusals_and_failures(ros, start_receiver, capfd):
    def good(_, response):
        response.success = True

    def refuses(_, response):
        response.success = True  # half done when it changed its mind
        raise InputError("rate 0: 0.001 to 1000 wanted")

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
        {"success": False, "message": "rate 0: 0.001 to 1000 wanted"},
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


def test_a_slow_handler_in_its_own_thread_holds_nobody_up(ros, peer):
    asked, answer = threading.Event(), threading.Event()

    def slow(_, response):
        asked.set()
        answer.wait(60.0)
        response.success = True

    ServiceServer(ros, TRIGGER, "~/slow", slow, in_thread=True)
    client = ServiceClient(ros, TRIGGER, "~/slow")
    client.wait(30.0)
    pending = client.start({})
    assert asked.wait(30.0)
    # The node takes replies and requests meanwhile: one at a time is served.
    assert ServiceClient(ros, "std_srvs/SetBool", "/peer/echo").call({"data": True}, 30.0).success
    busy = client.call({}, 30.0)
    assert not busy.success
    assert "busy with an earlier request" in busy.message
    answer.set()
    assert pending.result(30.0).success
    assert client.call({}, 30.0).success


def test_a_name_that_ros_refuses_is_one_line(ros):
    with pytest.raises(CallError, match="no service 'two words'") as caught:
        ServiceServer(ros, TRIGGER, "two words", lambda request, response: None)
    assert "\n" not in str(caught.value)
