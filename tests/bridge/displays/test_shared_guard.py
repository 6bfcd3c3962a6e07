"""Displays of one live node: what they show, and what they request. The tests leave it running."""

import json
import signal
import threading
import time
from contextlib import closing, suppress

import pytest
from marginguard_msgs.srv import Command, GetMesh

import marginguard as mg
from app.bridge import BridgeError, RosNode
from app.bridge.calls.service_client import ServiceClient
from app.bridge.displays import SessionClient
from app.bridge.displays.remote_operator import PAGE_NODE, PANEL_NODE
from app.fixture import Reason
from app.geometry import NS_PER_S
from app.runtime import ITEM_COMMANDS, AddNote, Rearm, SetMargins, SetTumor
from tests.bridge.conftest import SENDER, begin_live, started_in
from tests.bridge.displays.conftest import NODE, is_latched, is_tracked
from tests.bridge.live.guard_monitor import monitored
from tests.bridge.processes import Child
from tests.ros_domain import domain_in_environment
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

DISPLAY = f"""
from app.bridge import RosNode
from app.bridge.displays import SessionClient
with RosNode("{PAGE_NODE}_3") as ros:
    for step in SessionClient(ros, "{NODE}").steps():
        print(step.index, flush=True)
"""


@pytest.fixture(scope="module")
def domain_id():
    """The domain of the live node."""
    with domain_in_environment() as domain:
        yield domain


@pytest.fixture(scope="module", autouse=True)
def audit(domain_id, with_needle, frames_file, tmp_path_factory):
    """The audit log of a live node with a tracker."""
    folder = tmp_path_factory.mktemp("guard")
    with started_in(folder) as begin:

        def start(*arguments):
            return begin(Child, *arguments)

        begin_live(start, with_needle, "--audit", folder / "audit.jsonl")
        start(SENDER, frames_file, "tracked", "again")
        yield folder / "audit.jsonl"


def audited(audit, first=0, count=0):
    """Requests in the audit log from ``first`` on; waits until there are ``count``."""

    def requests():
        lines = audit.read_text().splitlines(keepends=True)
        events = [json.loads(line) for line in lines if line.endswith("\n")]
        return [each for each in events if each["event"] == "request"][first:]

    wait_until(lambda: len(requests()) >= count)
    return requests()


def test_page_and_panel_show_the_same_and_their_requests_name_them(display, audit):
    page, panel, first = display(), display(f"{PANEL_NODE}_1"), len(audited(audit))
    _, operator = page.until(is_tracked)
    content = operator.content
    assert content.name == "live example"
    assert operator.request(SetMargins(1.5, 6.0)) == ""
    for each in (page, panel):
        each.until(lambda step, now: now.content.margins.stop_mm == 1.5)
    panel.client.operator.request(ITEM_COMMANDS["needle"](5.0))
    page.until(lambda step, now: now.content.item("needle").length_mm == 65.0)
    panel.client.operator.request(AddNote("first cut"))
    _, now = page.until(lambda step, now: "first cut" in now.last_request.text)
    assert now.last_request.line == f"note from the panel (/{PANEL_NODE}_1) accepted: first cut"
    with pytest.raises(BridgeError, match="warn_mm is 3; expected more than stop_mm 4"):
        operator.request(SetMargins(4.0, 3.0))
    with pytest.raises(BridgeError, match="tumour: given in frame 'cautery'; expected 'needle'"):
        operator.request(SetTumor(content.tool_from_tip, content.tumor, 0.1))
    model_id = operator.request(SetTumor(content.frame_from_tumor, content.tumor, 0.3))
    assert model_id == content.model_id
    page.until(lambda step, now: now.content.tumor_sigma_mm == 0.3)
    expected = [
        ("set_margins", f"the page (/{PAGE_NODE}_1)", True),
        ("needle_length", f"the panel (/{PANEL_NODE}_1)", True),
        ("note", f"the panel (/{PANEL_NODE}_1)", True),
        ("set_margins", f"the page (/{PAGE_NODE}_1)", False),
        ("set_tumor", f"the page (/{PAGE_NODE}_1)", False),
        ("set_tumor", f"the page (/{PAGE_NODE}_1)", True),
    ]
    requests = audited(audit, first, len(expected))
    assert [(each["kind"], each["origin"], each["accepted"]) for each in requests] == expected


def test_script_follows_a_session_and_its_commands_name_it(audit):
    first = len(audited(audit))
    with mg.live_session(NODE, timeout_s=DEADLINE_S) as session:
        with pytest.raises(mg.InputError, match="no step has come yet"):
            _ = session.content
        steps = session.steps()
        next(each for each in steps if is_tracked(each, None))
        looser_mm = 0.5 * session.content.margins.stop_mm  # begins a hold
        assert session.request(mg.SetMargins(looser_mm, 4.0)) == ""
        while True:
            next(each for each in steps if is_latched(each, None))
            with suppress(mg.MarginGuardError):  # a pose that came late has begun another hold
                session.rearm()
                break
        next(each for each in steps if is_tracked(each, None) and not each.decision.hold)
        assert session.content.margins.stop_mm == looser_mm
        with pytest.raises(mg.MarginGuardError, match="warn_mm is 3; expected more than stop_mm 4"):
            session.request(mg.SetMargins(4.0, 3.0))
    # Margins, refused margins, and at least one request to re-arm.
    found = [(each["kind"], each["origin"].split(" (")[0]) for each in audited(audit, first, 3)]
    assert set(found) == {("set_margins", "the Python API"), ("rearm", "the Python API")}


def test_of_two_displays_one_rearm_counts(display):
    first, second = display(), display(f"{PAGE_NODE}_2")
    for each in (first, second):
        _, operator = each.until(is_tracked)
    stop_mm = operator.content.margins.stop_mm
    operator.request(SetMargins(0.5 * stop_mm, 4.0))  # looser ones begin a hold
    outcomes = []
    while outcomes.count("") != 1:
        outcomes.clear()
        _, operator = first.until(is_latched)
        seen = operator.seen()
        if not seen.nonce:
            continue

        def ask(display, seen=seen):
            try:
                outcomes.append(display.client.operator.request(Rearm(seen.seq, seen.nonce)))
            except BridgeError as error:
                outcomes.append(str(error))

        threads = [threading.Thread(target=ask, args=(each,)) for each in (first, second)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(DEADLINE_S)
        assert outcomes.count("") <= 1, outcomes
    first.until(lambda step, now: Reason.LATCHED not in step.decision.reasons)


def test_constraint_goes_on_while_a_display_is_stopped_and_after_it_is_killed(start, domain_id):
    """Each time until a constraint comes by poses that are a second younger than the fault."""
    child = start("-c", DISPLAY)
    child.line()
    with monitored(domain_id) as monitor:
        for fault in (signal.SIGSTOP, signal.SIGKILL):
            child.process.send_signal(fault)
            late_ns = time.time_ns() + NS_PER_S

            def is_late(each, late_ns=late_ns):
                stamp = each.message.header.stamp
                return stamp.sec * NS_PER_S + stamp.nanosec > late_ns

            monitor.until(is_late)


REFUSED = (
    ({"node": "/marginguard_page_9"}, "the node '/marginguard_page_9' has no client of it"),
    ({"node": ""}, "the node '' has no client of it"),
    ({"command": "stop_guard"}, "command: 'stop_guard'; expected one of rearm"),
    ({"arguments": "{}"}, "KeyError: 'text'; expected its arguments"),
    ({"arguments": " " * 64_001}, "64001 characters; expected at most 64000"),
    ({"arguments": '{"text": "' + "x" * 500 + '"}'}, "500 characters; expected at most 400"),
    ({"command": "rearm", "arguments": " " * 201}, "201 characters; expected at most 200"),
    ({"digest": "x", "triangles": [0, 1]}, "0 coordinates and 2 indices; expected multiples"),
    (
        {"digest": "x", "triangles": [0, 1, 2], "vertices": [0.0] * 9, "frame_id": "tumor"},
        "the surface has another digest than the request",
    ),
    ({"instance_id": "of another run"}, "the guard was started again since the display showed it"),
)


def test_request_that_is_not_a_displays_is_refused(display):
    page = display()
    page.until(lambda step, now: True)
    client = ServiceClient(page.ros, Command, f"{NODE}/command")
    values = {
        "node": f"/{PAGE_NODE}_1",
        "instance_id": page.client.operator._instance_id,
        "command": "note",
        "arguments": '{"text": "x"}',
    }

    def ask(changes):
        return client.call(Command.Request(**{**values, **changes}), DEADLINE_S)

    wait_until(lambda: ask({}).success)  # the guard has discovered the display
    for changes, problem in REFUSED:
        reply = ask(changes)
        assert not reply.success, changes
        assert problem in reply.message
    meshes = ServiceClient(page.ros, GetMesh, f"{NODE}/get_mesh")
    mesh = meshes.call(GetMesh.Request(digest="tumor/sha256:0"), DEADLINE_S)
    assert (mesh.success, len(mesh.vertices)) == (False, 0)
    assert "expected a digest of the present ~/content" in mesh.message


def test_display_that_stalls_gets_every_step_while_it_records_and_else_the_newest(
    display, domain_id, monkeypatch
):
    monkeypatch.setattr("app.bridge.displays.session_client._MAX_NEEDED", 40)
    other = display()
    with RosNode(f"{PANEL_NODE}_1", domain_id=domain_id) as ros:
        client = SessionClient(ros, NODE)
        with closing(client), closing(client.steps()) as steps:
            last = next(steps).index
            other.until(lambda step, _: step.index >= last + 30)
            shown = next(steps).index
            assert shown > last + 20
            client.needs_every, last = lambda: True, shown
            other.until(lambda step, _: step.index >= last + 30)
            taken = [next(steps).index for _ in range(30)]
            assert taken == list(range(last + 1, last + 31))
            other.until(lambda step, _: step.index >= last + 130)
            assert next(steps).index > last + 31 + 40
