"""What ROS users open must ask for what is published, with a promise that fits."""

import ast
from collections.abc import Iterator
from typing import Any

import yaml
from rclpy.qos import DurabilityPolicy

from app.bridge import topics
from app.bridge.qos import Topic
from app.bridge.session_publisher import NODE_NAME
from app.cli.main import build_parser

PUBLISHED = {
    topic.name.replace("~", f"/{NODE_NAME}"): topic
    for topic in vars(topics).values()
    if isinstance(topic, Topic)
}


def topics_of(entry: Any) -> Iterator[dict[str, Any]]:
    if isinstance(entry, dict):
        if "Durability Policy" in entry:
            yield entry
        entry = list(entry.values())
    if isinstance(entry, list):
        for item in entry:
            yield from topics_of(item)


def test_rviz_listens_to_topics_that_exist_and_are_latched(project_root):
    files = sorted((project_root / "rviz").glob("*.rviz"))
    assert files
    for path in files:
        asked = list(topics_of(yaml.safe_load(path.read_text())))
        assert asked
        for entry in asked:
            topic = PUBLISHED[entry["Value"]]
            latched = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert entry["Durability Policy"] == ("Transient Local" if latched else "Volatile")
            assert entry["Reliability Policy"] == "Reliable"


def test_the_launch_file_runs_a_command_line_that_parses(project_root):
    tree = ast.parse((project_root / "launch" / "replay.launch.py").read_text())
    (command,) = (
        node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "cmd"
    )
    assert isinstance(command, ast.List)
    # A launch configuration stands for a value that the user gives: 1 is a case and a rate.
    words = [item.value if isinstance(item, ast.Constant) else "1" for item in command.elts]
    options = build_parser().parse_args(words[1:])
    assert options.command == "replay"
    assert options.rate == 1.0
