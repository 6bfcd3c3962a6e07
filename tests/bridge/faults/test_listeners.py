"""Listeners of tf, descriptions and joints with a peer that sends harmful messages."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.conftest import Start
from tests.waiting import wait_until

pytestmark = pytest.mark.slow

HERE = Path(__file__).resolve().parent
TOPICS = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/clock": "rosgraph_msgs/msg/Clock",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/robot_description": "std_msgs/msg/String",
}
MAX_GROWTH_KB = 600_000
"""Allowed for over a hundred messages of 10 MB: Fast DDS keeps the memory of as many messages as
the depth of each subscription (20 and 20), and some are in transit."""


def attacked(start: Start, *attacks: str) -> dict[str, Any]:
    """Counts of the listeners after these attacks on tf and those on the other topics."""
    target = start("-m", "tests.bridge.faults.target")
    target.line(lambda line: line == "listening\n")
    hostile = start(HERE / "hostile.py", *map("=".join, TOPICS.items()), "--flood", "0.3")
    hostile.line(lambda line: line == "ready\n")

    def attack(what: str, topic: str, edge: str = "") -> None:
        hostile.send(f"{what} {topic} {edge}")
        hostile.line(lambda line: line.startswith(f"done {what}"))

    def until(accept: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Poll the counts until ``accept`` accepts them."""
        return wait_until(lambda: (found := target.ask("counts")) and accept(found) and found)

    at_rest_kb = until(bool)["memory_kb"]
    # Before the attacks, because a full buffer refuses new frames.
    attack("good", "/tf", "good better")
    until(lambda counts: counts["found"])
    for topic in ("/tf", "/tf_static"):
        for what in attacks:
            attack(what, topic)
    attack("clock", "/clock")
    attack("longest_joints", "/joint_states")
    # Again and again: best effort does not resend what a full socket dropped.
    for what, refusal in (("joints", "InputError"), ("long_joints", "longer than")):
        while not any(refusal in kind for kind in until(bool)["joints"]):
            attack(what, "/joint_states")
    attack("texts", "/robot_description")
    until(lambda counts: counts["descriptions_refused"] >= 1)
    attack("urdf", "/robot_description")
    attack("good", "/tf", "good better")
    counts = until(lambda counts: counts["found"] and counts["robots"])
    assert counts["robots"] == ["good_base"]
    assert counts["good_joints"] >= 1
    assert counts["failures"] == 0
    assert counts["memory_kb"] - at_rest_kb < MAX_GROWTH_KB
    return counts


def test_listeners_work_after_attacks(start):
    """A shorter form of the test of all attacks in ``test_live.py``."""
    counts = attacked(start, "nan", "names", "loops", "stamps", "bytes")
    assert counts["tf"]["TfInvalidError"] >= 10
