"""tf, descriptions and joints beside a peer that sends whatever does harm."""

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
"""Over a hundred messages of 10 MB: Fast DDS keeps the room of so many as each subscription is deep
(20 and 20), and some are on their way."""


def all_joints_counted(answer: dict[str, Any]) -> bool:
    """Whether good joints have come, and bad ones of every kind."""
    kinds = {kind for kind in answer["joints"] if "refused" in kind}
    return bool(answer["good_joints"]) and len(kinds) >= 2


def test_listeners_survive_hostile_peers(start: Start) -> None:
    target = start("-m", "tests.bridge.faults.target")
    target.line(lambda line: line == "listening\n")
    hostile = start(str(HERE / "hostile.py"), *map("=".join, TOPICS.items()), "--flood", "0.3")
    hostile.line(lambda line: line == "ready\n")

    def attack(what: str, topic: str, edge: str = "") -> None:
        hostile.say(f"{what} {topic} {edge}")
        hostile.line(lambda line: line.startswith(f"done {what}"))

    def until(wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Every question is answered, so this ends as soon as it is so, or by the deadline."""
        while True:
            target.say("how are you")
            answer = json.loads(target.line())
            if wanted(answer):
                return answer

    at_rest_kb = until(lambda answer: True)["memory_kb"]
    # Before the strangers: a full buffer takes no new frames, and says so.
    attack("good", "/tf", "good better")
    until(lambda answer: answer["found"])
    for topic in ("/tf", "/tf_static"):
        for what in ("nan", "huge", "names", "loops", "stamps", "bytes", "frames", "flood", "long"):
            attack(what, topic)
    attack("clock", "/clock")
    # To best effort nothing is said again that a full socket has dropped.
    while not all_joints_counted(until(lambda answer: True)):
        attack("joints", "/joint_states")
    attack("texts", "/robot_description")
    until(lambda answer: answer["descriptions_refused"] >= 1)
    attack("urdf", "/robot_description")
    attack("good", "/tf", "good better")
    answer = until(lambda answer: answer["found"] and answer["robots"])

    assert answer["robots"] == ["good_base"]
    assert answer["tf"]["TfInvalidError"] >= 50
    assert answer["tf"]["TooLong"] >= 1
    assert answer["failures"] == 0
    assert answer["memory_kb"] - at_rest_kb < MAX_GROWTH_KB
