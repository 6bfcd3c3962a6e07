"""Displays of a live node in another process: what they show, and what they request."""

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

import marginguard as mg
from app.bridge import BridgeError
from app.bridge.displays import LiveChild
from app.bridge.displays.remote_operator import PAGE_NODE
from app.bridge.displays.session_client import TransportDelay
from app.runtime import ChooseDepth, Rearm
from benchmarks.images.session import write_session
from tests.bridge.conftest import TRACKED
from tests.bridge.displays.conftest import NODE, is_latched, is_tracked
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow


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


@pytest.mark.parametrize("arguments", [{"node": 3}, {"timeout_s": 0.0}, {"timeout_s": "1"}])
def test_wrong_arguments_of_a_script_are_named(arguments):
    (name,) = arguments
    session = mg.live_session(**arguments)
    with pytest.raises(mg.InputError, match=f"{name}: is .*; expected "), session:
        pass


def test_killed_node_ends_the_steps_of_a_script_and_a_display_finds_the_next_node(
    display, start_live, start_sender, live_yaml, with_needle
):
    guard, page = start_live(with_needle), display()
    start_sender("tracked", "again")
    page.until(is_tracked)
    with mg.live_session(NODE, timeout_s=2.0) as session:
        steps = session.steps()
        next(steps)
        guard.end(signal.SIGKILL)
        with pytest.raises(mg.MarginGuardError, match=f"{NODE}: no step in 2 s"):
            for _ in steps:
                pass
    start_live(live_yaml(TRACKED))
    step, _ = page.until(lambda step, now: not now.content.items)
    assert step.decision.hold
    start_sender("tracked", "again")
    rearmed(page)
    assert page.error == ""


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


def test_child_that_cannot_start_gives_its_reason(tmp_path, monkeypatch, forked_nodes):
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
