"""Displays of a live node in another process: what they show, and what they request."""

import json
import os
import signal
import threading
import time
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import pytest
from marginguard_msgs.srv import Command, GetMesh

import marginguard as mg
from app.bridge import BridgeError, RosNode
from app.bridge.calls.service_client import ServiceClient
from app.bridge.displays import LiveChild, SessionClient
from app.bridge.displays.remote_operator import PAGE_NODE, PANEL_NODE
from app.bridge.displays.session_client import TransportDelay
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S, MarginGuardError
from app.runtime import ITEM_COMMANDS, AddNote, ChooseDepth, Rearm, SetMargins, SetTumor
from benchmarks.images.session import write_session
from tests.bridge.conftest import SENDER, TRACKED
from tests.bridge.live.guard_monitor import monitored
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

NODE = "/marginguard"
DISPLAY = f"""
from app.bridge import RosNode
from app.bridge.displays import SessionClient
with RosNode("{PAGE_NODE}_1") as ros:
    for step in SessionClient(ros, "{NODE}").steps():
        print(step.index, flush=True)
"""


class Display:
    """A display: its node, its client, and a thread that takes the steps."""

    def __init__(self, name: str, domain_id: int) -> None:
        self.ros = RosNode(name, domain_id=domain_id)
        self.client = SessionClient(self.ros, NODE)
        self.error = ""
        self._changed = threading.Condition()
        self._step = None
        self._thread = threading.Thread(target=self._take, daemon=True)
        self._thread.start()

    def until(self, condition):
        """The next step, with the operator, for which ``condition(step, operator)`` holds."""
        with self._changed:
            found = self._changed.wait_for(
                lambda: self.error or (self._step and condition(self._step, self.client.operator)),
                DEADLINE_S,
            )
            assert found, "no such step"
            assert not self.error, self.error
            return self._step, self.client.operator

    def close(self) -> None:
        self.client.close()
        self._thread.join()
        self.ros.close()

    def _take(self) -> None:
        try:
            for step in self.client.steps():
                with self._changed:
                    self._step = step
                    self._changed.notify_all()
        except MarginGuardError as error:
            self.error = str(error)
            with self._changed:
                self._changed.notify_all()


@pytest.fixture
def display(domain_id):
    """``display(NAME)`` is a display; closed after the test."""
    displays = []

    def begin(name=f"{PAGE_NODE}_1"):
        displays.append(Display(name, domain_id))
        return displays[-1]

    yield begin
    for each in displays:
        each.close()


def is_tracked(step, operator):
    return step.decision.state is not MarginState.UNKNOWN


def is_latched(step, operator):
    return is_tracked(step, operator) and Reason.LATCHED in step.decision.reasons


def rearmed(display):
    """Re-arm by ``display``, again if a pose that came late has begun another hold."""
    while True:
        _, operator = display.until(is_latched)
        seen = operator.seen()
        try:
            operator.request(Rearm(seen.seq, seen.nonce))
        except BridgeError as error:
            assert "nonce" in str(error) or "UNKNOWN" in str(error), error
        else:
            return


@pytest.fixture
def guard(start_live, start, frames_file, live_yaml, tmp_path):
    """A live node with a tracker; its audit log is ``audit.jsonl``."""
    config = live_yaml(TRACKED)
    with config.open("a") as file:
        file.write("needle: {frame: needle, length_mm: 60}\n")
    live = start_live(config, "--audit", tmp_path / "audit.jsonl")
    start(str(SENDER), str(frames_file), "tracked", "again")
    return live


def audited(tmp_path):
    lines = (tmp_path / "audit.jsonl").read_text().splitlines()
    return [each for line in lines if (each := json.loads(line))["event"] == "request"]


def test_page_and_panel_show_the_same_and_their_requests_name_them(guard, display, tmp_path):
    page, panel = display(), display(f"{PANEL_NODE}_1")
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
    found = [(each["kind"], each["origin"], each["accepted"]) for each in audited(tmp_path)]
    assert found == [
        ("set_margins", f"the page (/{PAGE_NODE}_1)", True),
        ("needle_length", f"the panel (/{PANEL_NODE}_1)", True),
        ("note", f"the panel (/{PANEL_NODE}_1)", True),
        ("set_margins", f"the page (/{PAGE_NODE}_1)", False),
        ("set_tumor", f"the page (/{PAGE_NODE}_1)", False),
        ("set_tumor", f"the page (/{PAGE_NODE}_1)", True),
    ]


def test_script_follows_a_session_and_its_commands_name_it(guard, domain_id, tmp_path):
    with mg.live_session(NODE, timeout_s=DEADLINE_S) as session:
        with pytest.raises(mg.InputError, match="no step has come yet"):
            _ = session.content
        steps = session.steps()
        next(each for each in steps if is_tracked(each, None))
        assert session.request(mg.SetMargins(0.5, 4.0)) == ""  # looser ones begin a hold
        while True:
            next(each for each in steps if is_latched(each, None))
            with suppress(mg.MarginGuardError):  # a pose that came late has begun another hold
                session.rearm()
                break
        next(each for each in steps if is_tracked(each, None) and not each.decision.hold)
        assert session.content.margins.stop_mm == 0.5
        with pytest.raises(mg.MarginGuardError, match="warn_mm is 3; expected more than stop_mm 4"):
            session.request(mg.SetMargins(4.0, 3.0))
    found = [(each["kind"], each["origin"].split(" (")[0]) for each in audited(tmp_path)]
    assert set(found) == {("set_margins", "the Python API"), ("rearm", "the Python API")}


def test_script_is_told_that_a_guard_has_ended(guard, domain_id):
    with mg.live_session(NODE, timeout_s=2.0) as session:
        steps = session.steps()
        next(steps)
        guard.process.kill()
        with pytest.raises(mg.MarginGuardError, match=f"{NODE}: no step in 2 s"):
            for _ in steps:
                pass


@pytest.mark.parametrize("arguments", [{"node": 3}, {"timeout_s": 0.0}, {"timeout_s": "1"}])
def test_wrong_arguments_of_a_script_are_named(arguments):
    (name,) = arguments
    session = mg.live_session(**arguments)
    with pytest.raises(mg.InputError, match=f"{name}: is .*; expected "), session:
        pass


def test_of_two_displays_one_rearm_counts(guard, display):
    first, second = display(), display(f"{PAGE_NODE}_2")
    for each in (first, second):
        each.until(is_tracked)
    first.client.operator.request(SetMargins(0.5, 4.0))  # looser ones begin a hold
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


def test_new_node_is_found_after_the_first_was_killed(
    guard, display, start_live, start_sender, live_yaml
):
    page = display()
    page.until(is_tracked)
    guard.end(signal.SIGKILL)
    start_live(live_yaml(TRACKED))
    step, _ = page.until(lambda step, now: not now.content.items)
    assert step.decision.hold
    start_sender("tracked", "again")
    rearmed(page)
    assert page.error == ""


def test_constraint_goes_on_while_a_display_is_stopped_and_after_it_is_killed(
    guard, start, domain_id
):
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


def test_request_that_is_not_a_displays_is_refused(guard, display):
    page = display()
    page.until(lambda step, now: True)
    client = ServiceClient(page.ros, Command, f"{NODE}/command")
    values = {
        "node": f"/{PAGE_NODE}_1",
        "instance_id": page.client.operator._instance_id,
        "command": "note",
        "arguments": '{"text": "x"}',
    }
    for changes, problem in REFUSED:
        reply = client.call(Command.Request(**{**values, **changes}), DEADLINE_S)
        assert not reply.success, changes
        assert problem in reply.message
    meshes = ServiceClient(page.ros, GetMesh, f"{NODE}/get_mesh")
    mesh = meshes.call(GetMesh.Request(digest="tumor/sha256:0"), DEADLINE_S)
    assert (mesh.success, len(mesh.vertices)) == (False, 0)
    assert "expected a digest of the present ~/content" in mesh.message


def test_display_that_stalls_gets_every_step_while_it_records_and_else_the_newest(
    guard, display, domain_id, monkeypatch
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


def test_display_without_a_node_says_so(display):
    page = display()
    assert page.client.silence == f"no live node {NODE} is there"
    assert page.client.operator is None


def test_child_goes_on_without_its_display_and_ends_in_order(
    domain_id, display, live_yaml, monkeypatch, tmp_path
):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    said = []
    child = LiveChild([f"--config={live_yaml(TRACKED)}"], said.append)
    try:
        page = display()
        page.until(lambda step, now: True)
        assert os.getsid(child.pid) == child.pid  # a terminal's Ctrl-C does not reach it
        assert child.ended == ""
    finally:
        child.close()
    assert "status 130" in child.ended
    assert any("audit log" in line for line in said)
    assert not child.log.exists()


def test_child_that_cannot_start_gives_its_reason(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    ended = threading.Event()
    child = LiveChild(
        [f"--config={tmp_path / 'none.yaml'}"],
        lambda line: ended.set() if "error" in line else None,
    )
    assert ended.wait(DEADLINE_S)
    wait_until(lambda: child.ended)  # the line comes before the process has ended
    child.close()
    expected = f"{tmp_path / 'none.yaml'} is not a live configuration: no such file"
    assert child.error == expected
    assert "status 2" in child.ended
    assert not list(Path(tmp_path / "state" / "marginguard" / "live_node").iterdir())


def test_display_that_joins_late_places_images_by_the_depth_in_use(
    start_live, display, live_yaml, tmp_path
):
    config = write_session(
        tmp_path / "session",
        calibrations=[
            {"depth_mm": 40, "path": "image_to_probe.txt"},
            {"depth_mm": 60, "matrix": np.diag([0.2, 0.2, 0.2, 1.0]).ravel().tolist()},
        ],
        depth_mm=40,
    )
    start_live(config)
    first = display()
    first.until(lambda step, now: True)
    first.client.operator.request(ChooseDepth(60.0))
    first.until(lambda step, now: now.content.image_depth.depth_mm == 60.0)
    late = display(f"{PAGE_NODE}_2")
    late.until(lambda step, now: True)
    assert {each.client.images._depths.depth_mm for each in (first, late)} == {60.0}


def test_message_that_waited_for_the_display_is_as_old_as_that():
    delay = TransportDelay()
    delay.note(10**18, 10**18 + 10**6, same_host=True)
    assert delay.last_ns == 10**6
    delay.note(10**18 + 10**7, 10**18 + 15 * 10**9, same_host=True)
    assert delay.last_ns == 15 * 10**9 - 10**7


def test_constant_delay_is_not_forgotten():
    delay, made_ns, offset_ns = TransportDelay(), 10**18, 10**12
    delay.note(made_ns, made_ns + offset_ns, same_host=False)
    for _ in range(6000):  # a minute
        made_ns += 10**7
        delay.note(made_ns, made_ns + offset_ns + 7 * 10**8, same_host=False)
    assert 6.9e8 < delay.last_ns <= 7e8


def test_delay_is_that_beyond_the_quickest_message():
    delay = TransportDelay()
    rng = np.random.default_rng(1)
    offset_ns, made_ns = 10**12, 0
    for _ in range(2000):
        made_ns += 10**7
        way_ns = int(rng.integers(10**5, 2 * 10**6))
        delay.note(made_ns, made_ns + offset_ns + way_ns, same_host=False)
        assert 0 <= delay.last_ns <= 2 * 10**6
    delay.note(made_ns, made_ns + offset_ns + 3 * 10**9, same_host=False)
    assert 2.99e9 < delay.last_ns <= 3e9
