"""The audit log lists starts, holds, causes, releases, requests and ends; it delays no step."""

import json
import threading
from dataclasses import replace
from types import SimpleNamespace

import pytest

from app.case import Activation
from app.fixture import MarginState, Reason
from app.runtime import AuditLog, AuditOutput, OperatorRequest, RequestKind
from tests.session_content import one_link_content

CONTENT = one_link_content()
NOW_NS = 1_700_000_000_123_456_789


def step(*causes, hold=True, activation=None):
    """Test double of a step: the values that the audit log reads."""
    decision = SimpleNamespace(
        hold=hold, state=MarginState.WARNING, reasons=(Reason.LATCHED,) if hold else (Reason.CLEAR,)
    )
    frame = SimpleNamespace(stamp=SimpleNamespace(ns=5), activation=activation)
    return SimpleNamespace(
        decision=decision, hold_causes=causes, index=3, frame=frame, playback="case"
    )


@pytest.fixture
def log(tmp_path):
    found = AuditLog(tmp_path / "audit.jsonl", {"pid": 7}, lambda: NOW_NS, pytest.fail)
    yield found
    found.close()


def lines(log):
    log.close()
    return [json.loads(line) for line in log.path.read_text().splitlines()]


def test_session_is_listed_from_start_to_stop(log):
    output = AuditOutput(log, CONTENT, lambda: 0)
    for each in (step("stale"), step("stale"), step("stale", "stop_mm lowered"), step(hold=False)):
        assert output.publish(each, None)
    looser = replace(CONTENT, margins=CONTENT.margins.replaced(stop_mm=0.5))
    output.prepare(looser)(looser)
    output.end()
    found = lines(log)
    events = ["start", "hold", "hold_cause", "released", "content", "stop"]
    assert [line["event"] for line in found] == events
    assert {(line["schema"], line["pid"], line["time_ns"]) for line in found} == {(1, 7, NOW_NS)}
    assert found[0]["time"] == "2023-11-14T22:13:20.123456Z"
    assert found[0]["model_id"] == CONTENT.model_id
    assert found[2]["causes"] == found[3]["causes"] == ["stale", "stop_mm lowered"]
    assert (found[1]["state"], found[1]["reasons"], found[1]["playback"]) == (
        "WARNING",
        ["latched"],
        "case",
    )
    assert found[5]["margins"]["stop_mm"] == 0.5


def test_causes_that_alternate_are_listed_within_a_rate(log):
    output = AuditOutput(log, CONTENT, lambda: 0)
    for number in range(1000):
        output.publish(step(f"fault {number % 2}"), None)
    assert len(lines(log)) == 2 + 20


def test_request_is_listed_with_its_outcome(log):
    log.request(OperatorRequest(RequestKind.REARM, "ROS", False, "nonce is 3", NOW_NS, 412))
    (line,) = lines(log)
    assert {key: line[key] for key in ("event", "kind", "origin", "accepted", "text")} == {
        "event": "request",
        "kind": "rearm",
        "origin": "ROS",
        "accepted": False,
        "text": "nonce is 3",
    }
    assert line["not_listed"] == 412


def test_stuck_or_full_disk_delays_nobody_and_is_counted(tmp_path, monkeypatch):
    stuck, go_on = threading.Event(), threading.Event()
    warned = []
    log = AuditLog(tmp_path / "audit.jsonl", {}, lambda: NOW_NS, warned.append)
    write = log._file.append

    def full(line):
        stuck.set()
        assert go_on.wait(60.0)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(log._file, "append", full)
    log.add("first", {})
    assert stuck.wait(60.0)
    monkeypatch.setattr(log._file, "append", write)
    log.add("second", {})  # returns although the disk does not
    go_on.set()
    (line,) = lines(log)
    assert (line["event"], line["lost"]) == ("second", 1)
    assert "No space left on device" in warned[0]


def test_changes_of_the_cautery_are_listed(log):
    output = AuditOutput(log, CONTENT, lambda: 0)
    unknown, off, on = Activation.UNKNOWN, Activation.OFF, Activation.ON
    for state in (unknown, off, off, on, on, off, unknown):
        output.publish(step(hold=False, activation=state), None)
    found = [line for line in lines(log) if line["event"] == "cautery"]
    assert [line["cautery"] for line in found] == ["unknown", "off", "on", "off", "unknown"]
    assert {(line["step"], line["stamp_ns"]) for line in found} == {(3, 5)}
