"""``marginguard live`` beside a good tracker and a peer that sends whatever does harm.

``MARGINGUARD_FLOOD_S`` makes the floods longer than the half second of the suite.
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
from app.bridge.qos import STREAM, Topic
from tests.bridge.conftest import Receiver, StartReceiver
from tests.bridge.live.conftest import Child, Start

SENDER = Path(__file__).resolve().parents[1] / "live" / "sender.py"
HOSTILE = Path(__file__).resolve().parent / "hostile.py"
FLOOD_S = os.environ.get("MARGINGUARD_FLOOD_S", "0.5")
USED = "tracker cautery"
MAX_GROWTH_KB = 50_000
"""For everything but messages of megabytes, of which the middleware itself keeps some."""

LONG_KB = 10_000
MAX_GROWTH_WITH_LONG_KB = {"tracked": 30 * LONG_KB, "tf": 50 * LONG_KB}
"""For 60 messages of 10 MB: Fast DDS keeps the room of so many as a subscription is deep (20, and
on /tf there are two), and some copies are on their way."""

REASONS = {"lost": "not_finite", "skew": "not_rigid", "future": "future_stamp"}
"""What an attack on the edge of the tool makes of the margin."""

COUNTED = (
    ("bytes", "{}: refused (InputError)"),
    ("names", "{}: refused (FrameError)"),
    ("names", "frame names of more than 256 letters"),
    ("frames", "edges beyond 256"),
)
"""What diagnostics count of an attack; ``{}`` is the topic."""

REFUSED = {
    "nan": "a command is not finite",
    "names": "frame of a command",
    "stamps": "a command is too old",
    "huge": "a command is not finite",
}
"""What diagnostics say of an attack with commands."""

TOPICS = {
    "tf": ("/tf", "tf2_msgs/msg/TFMessage", {"tf": {}, "clock": "host"}),
    "tracked": (
        "/tracked_transforms",
        "marginguard_msgs/msg/TrackedTransform",
        {"tracked_transforms": {}, "clock": "host"},
    ),
}


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """The live session, seen from outside; ``topic`` is what ``hostile`` attacks."""

    live: Child
    receiver: Receiver
    hostile: Child
    topic: str

    def attack(self, what: str, edge: str = "") -> int:
        """How many messages the attack had."""
        self.hostile.say(f"{what} {self.topic} {edge}")
        return int(self.hostile.line(lambda line: line.startswith(f"done {what}")).split()[2])

    def attack_until_counted(self, what: str, key: str) -> None:
        """Attack until diagnostics have ``key``: of a burst a busy process keeps the last."""
        self.attack(what)
        while key not in self.until(lambda said: True, time.time_ns()):
            self.attack(what)

    def until(self, wanted: Callable[[dict[str, str]], bool], begun_ns: int = 0) -> dict[str, str]:
        """All that diagnostics say (``part: key``) from now on, as soon as it is as wanted."""
        begun_ns = begun_ns or time.time_ns()
        while True:
            message = self.receiver.take(1)[0]["message"]
            stamp = message["header"]["stamp"]
            if stamp["sec"] * 10**9 + stamp["nanosec"] < begun_ns:
                continue
            said = {
                f"{part['name'].removeprefix('marginguard: ')}: {value['key']}": value["value"]
                for part in message["status"]
                for value in part["values"]
            }
            if wanted(said):
                return said

    def works(self) -> dict[str, str]:
        """What is said when the margin is next known."""
        return self.until(lambda said: said["margin: state"] in ("NEGATIVE", "WARNING", "POSITIVE"))

    def unknown(self, reason: str, what: str) -> None:
        """Attack the used edge; return when the margin has been UNKNOWN for this reason."""
        begun_ns = time.time_ns()
        self.attack(what, USED)
        self.until(
            lambda said: (
                said["margin: state"] == "UNKNOWN" and reason in said["margin: reasons"].split(", ")
            ),
            begun_ns,
        )

    @property
    def memory_kb(self) -> int:
        """The most that the process has held so far."""
        text = Path(f"/proc/{self.live.process.pid}/status").read_text()
        found = re.search(r"VmHWM:\s+(\d+) kB", text)
        assert found is not None
        return int(found[1])


@pytest.fixture
def watch(
    start: Start, start_receiver: StartReceiver, live_yaml: Any, frames_file: Path
) -> Callable[[str], Watched]:
    def begin(kind: str) -> Watched:
        topic, message_type, source = TOPICS[kind]
        words = ("live", "--constraint-hz", "100", "--config", str(live_yaml(source)))
        live = start("-m", "app.cli", *words)
        live.line(lambda line: line.startswith("UNKNOWN"))  # before others take their turns
        hostile = start(str(HOSTILE), f"{topic}={message_type}", "--flood", FLOOD_S)
        start(str(SENDER), str(frames_file), kind, "again")
        receiver = start_receiver("/diagnostics:diagnostic_msgs/msg/DiagnosticArray:1000000")
        hostile.line(lambda line: line == "ready\n")
        watched = Watched(live, receiver, hostile, topic)
        watched.works()
        return watched

    return begin


@pytest.mark.parametrize("kind", ["tf", "tracked"])
def test_live_session_survives_hostile_peers(watch: Callable[[str], Watched], kind: str) -> None:
    watched = watch(kind)
    name = TOPICS[kind][0]
    at_rest_kb = watched.memory_kb

    for what in ("nan", "huge", "loops", "stamps", "flood"):
        watched.attack(what)
    for what, count in COUNTED:
        watched.attack_until_counted(what, "source: " + count.format(name))
    watched.works()
    for what, reason in REASONS.items():
        watched.unknown(reason, what)
        watched.works()
    assert watched.memory_kb - at_rest_kb < MAX_GROWTH_KB

    watched.attack_until_counted("long", f"source: {name}: refused (longer than 1048576 bytes)")
    said = watched.works()
    assert int(said[f"source: {name}: messages"]) >= 1_000
    assert int(said["tracking: tracker -> cautery: lost samples"]) >= 10
    assert watched.memory_kb - at_rest_kb < MAX_GROWTH_WITH_LONG_KB[kind]
    assert watched.live.end(signal.SIGINT) == 130
    assert "Traceback" not in watched.live.log.read_text()


def test_hostile_commands_give_no_motion_and_clock_is_ignored(
    watch: Callable[[str], Watched], start: Start, domain_id: int
) -> None:
    watched = watch("tf")
    topic = "/marginguard/desired_twist"
    hostile = start(str(HOSTILE), f"{topic}=geometry_msgs/msg/TwistStamped", "--flood", FLOOD_S)
    hostile.line(lambda line: line == "ready\n")
    watched = replace(watched, hostile=hostile, topic=topic)
    answers: list[TwistStamped] = []
    with RosNode("controller", domain_id=domain_id) as ros:
        allowed = Topic("/marginguard/allowed_twist", TwistStamped, STREAM)
        ros.subscribe(allowed, answers.append)
        for what, reason in REFUSED.items():
            key = f"source: twists refused: {reason}"
            while key not in watched.until(lambda said: True) or not answers:
                watched.attack(what, "tumor -")
        assert all(motion(answer) == 0.0 for answer in answers)
        # A clock from elsewhere, forward and back: the session is on the system's own.
        clock = ros.publisher(topics.CLOCK)
        for sec in (10**9, 0, 2**31 - 1):
            clock.publish(Clock(clock=Time(sec=sec)))
        watched.attack("flood", "tumor -")
        watched.works()
        assert clock.get_subscription_count() == 0
    # What is allowed of a flood of good and bad ones is never faster than the limit.
    assert max(map(motion, answers)) <= 0.25 + 1e-9
    assert watched.live.end(signal.SIGINT) == 130
    assert "Traceback" not in watched.live.log.read_text()


def motion(answer: TwistStamped) -> float:
    """How fast it is, m/s; NaN for what is not finite, which is not less than anything."""
    linear, angular = answer.twist.linear, answer.twist.angular
    turns = math.hypot(angular.x, angular.y, angular.z)
    return math.hypot(linear.x, linear.y, linear.z) + 0.0 * turns
