"""Listeners of tf, descriptions and joints with a peer that sends harmful messages."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.bridge.live.conftest import Start

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


def all_joints_counted(counts: dict[str, Any]) -> bool:
    """True if valid joints and invalid ones of at least two kinds are counted."""
    kinds = {kind for kind in counts["joints"] if "refused" in kind}
    return bool(counts["good_joints"]) and len(kinds) >= 2


def test_listeners_work_after_all_attacks(start: Start) -> None:
    target = start("-m", "tests.bridge.faults.target")
    target.line(lambda line: line == "listening\n")
    hostile = start(str(HERE / "hostile.py"), *map("=".join, TOPICS.items()), "--flood", "0.3")
    hostile.line(lambda line: line == "ready\n")

    def attack(what: str, topic: str, edge: str = "") -> None:
        hostile.send(f"{what} {topic} {edge}")
        hostile.line(lambda line: line.startswith(f"done {what}"))

    def until(accept: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Poll the counts until ``accept`` accepts them."""
        while True:
            target.send("counts")
            counts = json.loads(target.line())
            if accept(counts):
                return counts

    at_rest_kb = until(lambda counts: True)["memory_kb"]
    # Before the attacks, because a full buffer refuses new frames.
    attack("good", "/tf", "good better")
    until(lambda counts: counts["found"])
    for topic in ("/tf", "/tf_static"):
        for what in ("nan", "huge", "names", "loops", "stamps", "bytes", "frames", "flood", "long"):
            attack(what, topic)
    attack("clock", "/clock")
    # Repeat the attack: best effort does not resend what a full socket dropped.
    while not all_joints_counted(until(lambda counts: True)):
        attack("joints", "/joint_states")
    attack("texts", "/robot_description")
    until(lambda counts: counts["descriptions_refused"] >= 1)
    attack("urdf", "/robot_description")
    attack("good", "/tf", "good better")
    counts = until(lambda counts: counts["found"] and counts["robots"])

    assert counts["robots"] == ["good_base"]
    assert counts["tf"]["TfInvalidError"] >= 50
    assert counts["tf"]["TooLong"] >= 1
    assert counts["failures"] == 0
    assert counts["memory_kb"] - at_rest_kb < MAX_GROWTH_KB
