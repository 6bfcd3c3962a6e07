"""``marginguard live`` with a valid tracker and a peer that sends harmful messages.

``MARGINGUARD_FLOOD_S`` sets the duration of the floods, 0.5 s by default.
"""

import math
import os
import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from rosgraph_msgs.msg import Clock

from app.bridge import topics
from app.bridge.node import RosNode
from app.bridge.topics import STREAM, Topic
from tests.bridge.conftest import Receiver, Start, StartReceiver
from tests.bridge.faults.test_listeners import attacked
from tests.bridge.processes import Child

pytestmark = pytest.mark.long

SENDER = Path(__file__).resolve().parents[1] / "live" / "sender.py"
HOSTILE = Path(__file__).resolve().parent / "hostile.py"
FLOOD_S = os.environ.get("MARGINGUARD_FLOOD_S", "0.5")
USED = "tracker cautery"
MAX_GROWTH_KB = 50_000
"""For all attacks other than "long", whose messages the middleware keeps."""

LONG_KB = 10_000
MAX_GROWTH_WITH_LONG_KB = {"tracked": 30 * LONG_KB, "tf": 50 * LONG_KB}
"""For 60 messages of 10 MB: Fast DDS keeps the memory of as many messages as the depth of a
subscription (20; /tf has two), and some copies are in transit."""

SECOND_SENDER_ATTACKS = ("lost", "skew", "future")
"""Attacks on the edge of the tool, which the tracker sends too."""

COUNTED = (
    ("bytes", "{}: refused (InputError)"),
    ("names", "{}: refused (FrameError)"),
    ("names", "frame names of more than 256 letters"),
    ("frames", "edges beyond 256"),
)
"""Attacks and the counts of them in the diagnostics; ``{}`` is the topic."""

REFUSED = {
    "nan": "a command is not finite",
    "names": "frame of a command",
    "stamps": "a command is too old",
    "huge": "a command is not finite",
}
"""Count in the diagnostics by attack with commands."""

TOPICS = {
    "tf": ("/tf", "tf2_msgs/msg/TFMessage", {"tf": {}, "clock": "host"}),
    "tracked": (
        "/tracked_transforms",
        "marginguard_msgs/msg/TrackedTransform",
        {"tracked_transforms": {}, "clock": "host"},
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class SessionUnderAttack:
    """A live session, a receiver of its diagnostics, and ``hostile``, which attacks ``topic``."""

    live: Child
    receiver: Receiver
    hostile: Child
    topic: str

    def attack(self, what: str, edge: str = "") -> int:
        """Perform the attack; return its number of messages."""
        self.hostile.send(f"{what} {self.topic} {edge}")
        return int(self.hostile.line(lambda line: line.startswith(f"done {what}")).split()[2])

    def attack_until_counted(self, what: str, key: str) -> None:
        """Attack until the diagnostics have ``key``: a busy process drops parts of a burst."""
        self.attack(what)
        while key not in self.until(lambda values: True, time.time_ns()):
            self.attack(what)

    def until(self, accept: Callable[[dict[str, str]], bool], begun_ns: int = 0) -> dict[str, str]:
        """Wait for diagnostics (values by ``part: key``) that ``accept`` accepts.

        Diagnostics older than ``begun_ns``, by default now, are skipped.
        """
        begun_ns = begun_ns or time.time_ns()
        while True:
            message = self.receiver.take(1)[0]["message"]
            stamp = message["header"]["stamp"]
            if stamp["sec"] * 10**9 + stamp["nanosec"] < begun_ns:
                continue
            values = {
                f"{part['name'].removeprefix('marginguard: ')}: {value['key']}": value["value"]
                for part in message["status"]
                for value in part["values"]
            }
            if accept(values):
                return values

    def wait_until_known(self) -> dict[str, str]:
        """Wait until the margin is known; return the diagnostics."""
        known = ("NEGATIVE", "WARNING", "POSITIVE")
        return self.until(lambda values: values["margin: state"] in known)

    def attack_until_unknown(self, reason: str, what: str) -> None:
        """Attack the tool's edge; wait until the margin is UNKNOWN for ``reason``."""
        begun_ns = time.time_ns()
        self.attack(what, USED)
        self.until(
            lambda values: (
                values["margin: state"] == "UNKNOWN"
                and reason in values["margin: reasons"].split(", ")
            ),
            begun_ns,
        )

    @property
    def memory_kb(self) -> int:
        """Peak memory of the process in kB."""
        text = Path(f"/proc/{self.live.process.pid}/status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", text)
        assert found is not None
        return int(found[1])


@pytest.fixture
def start_session(
    start_live: Start,
    start_sender: Start,
    start: Start,
    start_receiver: StartReceiver,
    live_yaml: Any,
) -> Callable[[str], SessionUnderAttack]:
    def begin(kind: str) -> SessionUnderAttack:
        topic, message_type, source = TOPICS[kind]
        live = start_live(live_yaml(source))  # before the other processes load the machine
        hostile = start(HOSTILE, f"{topic}={message_type}", "--flood", FLOOD_S)
        start_sender(kind, "again")
        receiver = start_receiver("/diagnostics:diagnostic_msgs/msg/DiagnosticArray:1000000")
        hostile.line(lambda line: line == "ready\n")
        session = SessionUnderAttack(live, receiver, hostile, topic)
        session.wait_until_known()
        return session

    return begin


@pytest.mark.parametrize("kind", ["tf", "tracked"])
def test_live_session_works_after_all_attacks(start_session, kind):
    session = start_session(kind)
    name = TOPICS[kind][0]
    at_rest_kb = session.memory_kb

    for what in ("nan", "huge", "loops", "stamps", "flood"):
        session.attack(what)
    for what, count in COUNTED:
        session.attack_until_counted(what, "source: " + count.format(name))
    session.wait_until_known()
    assert session.memory_kb - at_rest_kb < MAX_GROWTH_KB

    session.attack_until_counted("long", f"source: {name}: refused (longer than 1048576 bytes)")
    session.wait_until_known()
    session.until(lambda values: int(values[f"source: {name}: messages"]) >= 1_000)
    assert session.memory_kb - at_rest_kb < MAX_GROWTH_WITH_LONG_KB[kind]

    # No sample of a second sender is used, whatever it is.
    for what in SECOND_SENDER_ATTACKS:
        session.attack_until_unknown("second_sender", what)
    assert session.hostile.end(signal.SIGINT) != 0
    values = session.wait_until_known()
    refused = int(values["source: samples of a second sender"])
    assert refused >= 10
    # On a busy machine the true sender may be silent for 100 ms, after which the other takes over.
    assert int(values["tracking: tracker -> cautery: lost samples"]) < refused
    session.live.stop()


def test_listeners_work_after_all_attacks(start):
    attacks = ("nan", "huge", "names", "loops", "stamps", "bytes", "frames", "flood", "long")
    counts = attacked(start, *attacks)
    assert counts["tf"]["TfInvalidError"] >= 50
    assert counts["tf"]["TooLong"] >= 1


def test_hostile_commands_give_no_motion_and_clock_is_ignored(start_session, start, domain_id):
    session = start_session("tf")
    topic = "/marginguard/desired_twist"
    hostile = start(HOSTILE, f"{topic}=geometry_msgs/msg/TwistStamped", "--flood", FLOOD_S)
    hostile.line(lambda line: line == "ready\n")
    session = replace(session, hostile=hostile, topic=topic)
    answers: list[TwistStamped] = []
    with RosNode("controller", domain_id=domain_id) as ros:
        allowed = Topic("/marginguard/allowed_twist", TwistStamped, STREAM)
        ros.subscribe(allowed, answers.append)
        for what, reason in REFUSED.items():
            key = f"source: twists refused: {reason}"
            while key not in session.until(lambda values: True) or not answers:
                session.attack(what, "tumor -")
        assert all(speed(answer) == 0.0 for answer in answers)
        # Another node's clock, forward and back: the session uses the system's clock.
        clock = ros.publisher(topics.CLOCK)
        for sec in (10**9, 0, 2**31 - 1):
            clock.publish(Clock(clock=Time(sec=sec)))
        session.attack("flood", "tumor -")
        session.wait_until_known()
        assert clock.get_subscription_count() == 0
    # During a flood of valid and invalid commands the speed stays within the limit.
    assert max(map(speed, answers)) <= 0.25 + 1e-9
    session.live.stop()


def speed(answer: TwistStamped) -> float:
    """Speed in m/s; NaN if any component is not finite, so that every comparison fails."""
    linear, angular = answer.twist.linear, answer.twist.angular
    rotation = math.hypot(angular.x, angular.y, angular.z)
    return math.hypot(linear.x, linear.y, linear.z) + 0.0 * rotation
