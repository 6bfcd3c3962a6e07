"""``marginguard rearm``: its text, its question and its exit status."""

import io
import math
import os
import sys
import threading
import time
from unittest.mock import patch

import pytest
from builtin_interfaces.msg import Time
from marginguard_msgs.msg import FixtureConstraint

from app.bridge.control.operator_requests import OperatorList, OperatorRequests
from app.bridge.control.operator_services import RearmClient, RearmService
from app.bridge.node import RosNode
from app.bridge.publishing.constraint_stream import ConstraintStream
from app.bridge.ros_errors import BridgeError
from app.bridge.topics import CONSTRAINT, NEWEST, Topic
from app.cli.commands import rearm
from app.cli.main import main
from app.runtime import RequestLog
from tests.cli.command import run

pytestmark = pytest.mark.slow


def test_without_guard_the_exit_status_is_2(domain_id, monkeypatch):
    monkeypatch.setattr(rearm, "TIMEOUT_S", 0.2)
    error = run("rearm", "--yes", "--namespace", "left", status=2).err
    assert "/left/marginguard/constraint: no constraint within 0.2 s; expected" in error


def test_without_terminal_the_operator_has_to_say_yes(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    assert "standard input is not a terminal" in run("rearm", status=2).err


def test_output_without_terminal_displays_no_hold(terminal, capsys):
    terminal.stdout.close()
    terminal.stdout = io.StringIO()
    assert terminal.rearm() == 2
    assert "standard output is not a terminal" in capsys.readouterr().err


class Guard:
    """Node with the topic and the service of a guard on hold; counts how often it is re-armed."""

    def __init__(self, ros):
        self.rearmed = 0
        self.stream = ConstraintStream(ros.publisher(CONSTRAINT), 50.0)
        self.holds = self.stream
        log = RequestLog(time.time_ns, time.monotonic_ns)
        RearmService(ros, self, OperatorRequests(ros, log, OperatorList(ros, None)))
        self.publish()

    def publish(self, state=FixtureConstraint.WARNING, reasons=("latched",), causes=()):
        message = FixtureConstraint(
            state=state, hold=True, reasons=list(reasons), hold_causes=list(causes)
        )
        self.stream.publish(message)

    def check_rearm(self, seen):
        """Check like `OperatorCommands.check_rearm`."""
        self.holds.check(seen)

    def rearm(self, seen, origin):
        """Re-arm like `OperatorCommands.rearm`, without a session."""
        self.holds.check(seen)
        self.rearmed += 1


@pytest.fixture
def guard(domain_id):
    with RosNode("marginguard", domain_id=domain_id) as ros:
        found = Guard(ros)
        yield found
        found.stream.close()


class Terminal:
    """Pseudo-terminal whose user answers each question after ``before_answer()``."""

    def __init__(self):
        self.keyboard, self.program = os.openpty()
        self.stdin = os.fdopen(os.dup(self.program), "r")
        self.stdout = os.fdopen(os.dup(self.program), "w")
        self.text = ""
        self.answer, self.before_answer = "y", lambda: None
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def rearm(self):
        """Run ``marginguard rearm`` in this terminal; returns its exit status."""
        with patch.object(sys, "stdin", self.stdin), patch.object(sys, "stdout", self.stdout):
            return main(["rearm"])

    def type(self, text):
        os.write(self.keyboard, text.encode())

    def _read(self):
        while chunk := os.read(self.keyboard, 4096):
            self.text += chunk.decode()
            if self.text.endswith("\x04"):
                return
            if self.text.endswith("[y/N] "):
                self.before_answer()
                self.type(f"{self.answer}\n")

    def printed(self):
        """Everything that was printed; nothing is read afterwards."""
        if self._thread.is_alive():
            os.write(self.program, b"\x04")
        self._thread.join(30.0)
        return self.text.rstrip("\x04")

    def close(self):
        for stream in (self.stdin, self.stdout):
            stream.close()
        for descriptor in (self.keyboard, self.program):
            os.close(descriptor)


@pytest.fixture
def terminal():
    found = Terminal()
    yield found
    found.printed()
    found.close()


def test_answer_to_the_displayed_hold_rearms_it(guard, terminal):
    assert terminal.rearm() == 0
    assert guard.rearmed == 1
    assert terminal.printed().splitlines()[-1] == "re-armed"


def test_answer_typed_before_the_hold_is_displayed_is_discarded(guard, terminal):
    terminal.answer = "n"
    terminal.type("y\n")
    assert terminal.rearm() == 1
    assert guard.rearmed == 0
    assert terminal.printed().splitlines()[-1] == "not re-armed"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            lambda guard: (
                guard.publish(FixtureConstraint.UNKNOWN, ["latched", "stale"]),
                guard.publish(),
            ),
            "the displayed hold was replaced by another one",
        ),
        (lambda guard: guard.publish(FixtureConstraint.POSITIVE), "the state is POSITIVE by now"),
        (lambda guard: guard.publish(reasons=["latched", "drift"]), "reasons were added: drift"),
        (
            lambda guard: guard.publish(causes=["stop_mm lowered from 2 to 1"]),
            "the displayed hold was replaced by another one; "
            "causes were added: stop_mm lowered from 2 to 1",
        ),
    ],
    ids=["nonce", "state", "reasons", "causes"],
)
def test_answer_is_refused_when_the_hold_is_worse_than_the_displayed_one(
    guard, terminal, change, text
):
    terminal.before_answer = lambda: change(guard)
    assert terminal.rearm() == 1
    assert guard.rearmed == 0
    line = terminal.printed().splitlines()[-1]
    assert line == f"not re-armed: {text}; start again to see the present hold"


def test_improved_hold_is_the_displayed_one_and_an_ended_hold_is_not():
    seen = FixtureConstraint(state=2, hold=True, reasons=["tissue", "latched"], rearm_nonce=9)
    better = FixtureConstraint(state=0, hold=True, reasons=["latched", "clear"], rearm_nonce=9)
    assert rearm.changes_for_the_worse(seen, better) == []
    ended = FixtureConstraint(state=0, reasons=["clear"])
    assert rearm.changes_for_the_worse(seen, ended)[0] == "the displayed hold has ended"


def no_reply(guard, then):
    """Let the guard call ``then()`` for a request and not reply in time."""
    replied = threading.Event()

    def rearm(seen, origin):
        then()
        replied.wait(30.0)

    guard.rearm = rearm
    return replied


@pytest.mark.parametrize(
    ("then", "status", "text"),
    [
        (
            lambda guard: guard.stream.publish(FixtureConstraint(state=0, reasons=["clear"])),
            0,
            "the next constraint is not on hold: re-armed",
        ),
        (lambda guard: None, 1, "still on hold: the request was not carried out so far."),
        (lambda guard: guard.publish(causes=["another"]), 1, "on another hold, nonce "),
    ],
    ids=["ended", "lasts", "another"],
)
def test_without_a_reply_the_next_constraint_says_what_happened(
    guard, monkeypatch, then, status, text
):
    monkeypatch.setattr(rearm, "TIMEOUT_S", 1.0)
    replied = no_reply(guard, lambda: then(guard))
    try:
        printed = run("rearm", "--yes", status=status).out
    finally:
        replied.set()
    no_answer, outcome = printed.splitlines()[-2:]
    assert no_answer.startswith("no reply: ")
    assert outcome.startswith(text)


def test_refusal_is_printed_with_the_next_constraint(guard):
    guard.publish(FixtureConstraint.UNKNOWN)  # a fault, whose cause persists

    def refuse(seen):
        raise BridgeError("the state is UNKNOWN")

    guard.check_rearm = refuse
    printed = run("rearm", "--yes", status=1).out
    nonce = guard.stream.present().nonce
    assert printed.splitlines()[-2:] == [
        "refused: the state is UNKNOWN",
        f"next constraint: on hold, nonce {nonce} (reasons: latched)",
    ]


def test_refusal_is_printed_when_the_guard_leaves(guard, monkeypatch):
    monkeypatch.setattr(rearm, "TIMEOUT_S", 2.0)

    def refuse(seen, origin):
        guard.stream.close()
        raise BridgeError("the state is UNKNOWN")

    guard.rearm = refuse
    refused, after = run("rearm", "--yes", status=1).out.splitlines()[-2:]
    assert refused == "refused: the state is UNKNOWN"
    assert after.startswith("the hold after the refusal is not known: /marginguard/constraint: no")


def test_no_request_is_sent_when_a_second_guard_has_started(guard, domain_id):
    with RosNode("operator", domain_id=domain_id) as ros:
        client = RearmClient(ros, "marginguard")
        seen = client.constraint(30.0)
        with RosNode("second", domain_id=domain_id) as second:
            topic = Topic("/marginguard/constraint", FixtureConstraint, NEWEST)
            second.publisher(topic)
            assert second.wait_for_subscribers(topic, 1, 30.0)
            while ros.node.count_publishers(topic.name) < 2:
                time.sleep(0.02)
            with pytest.raises(BridgeError, match="2 publishers; expected a single guard"):
                client.rearm(seen, 30.0)
    assert guard.rearmed == 0


def test_text_names_state_reasons_begin_and_ids():
    held = FixtureConstraint(
        state=FixtureConstraint.WARNING,
        hold=True,
        reasons=["warning_distance", "latched"],
        hold_causes=["tumour replaced", "stop_mm lowered from 2 to 1"],
        hold_since=Time(sec=1000),
        signed_distance=0.0042,
        model_id="sha256:1",
        instance_id="00ff",
        seq=7,
        rearm_nonce=9,
    )
    text = rearm.hold_text(held, "/marginguard/constraint", 1041.2)
    lines = text.splitlines()
    assert lines[0] == "/marginguard/constraint: WARNING, on hold"
    rows = {line[2:17].strip(): line[17:] for line in lines[1:]}
    assert rows["reasons"] == "warning_distance, latched"
    assert rows["on hold since"].endswith("(41 s)")
    assert rows["distance"] == "4.20 mm"
    assert rows["causes"] == "tumour replaced"
    assert "\n                 stop_mm lowered from 2 to 1\n" in text
    assert (rows["tumour"], rows["registration"], rows["guard"]) == ("sha256:1", "none", "00ff")
    assert rows["seq, nonce"] == "7, 9"


def test_unknown_distance_is_no_number_in_the_text():
    unknown = FixtureConstraint(
        state=FixtureConstraint.UNKNOWN, hold=True, reasons=["silent"], signed_distance=math.nan
    )
    text = rearm.hold_text(unknown, "/c", 1.0)
    assert text.startswith("/c: UNKNOWN, on hold\n")
    assert "  distance       unknown\n" in text
    assert "nan" not in text


def test_text_of_a_free_guard_is_one_line():
    free = FixtureConstraint(state=FixtureConstraint.NEGATIVE)
    assert rearm.hold_text(free, "/c", 0.0) == "/c: NEGATIVE, not on hold"
