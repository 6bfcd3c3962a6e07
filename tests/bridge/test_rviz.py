"""RViz, launch and Foxglove files must match the published topics and the commands."""

import ast
import json
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from rclpy.qos import DurabilityPolicy

from app.bridge import topics
from app.bridge.publishing.session_publisher import NODE_NAME
from app.bridge.topics import Topic
from app.cli.main import build_parser
from app.fixture import MarginState

pytestmark = pytest.mark.slow

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


def test_rviz_subscribes_to_existing_topics_with_matching_qos(project_root):
    files = sorted((project_root / "rviz").glob("*.rviz"))
    assert files
    for path in files:
        subscribed = list(topics_of(yaml.safe_load(path.read_text())))
        assert subscribed
        for entry in subscribed:
            topic = PUBLISHED[entry["Value"]]
            latched = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert entry["Durability Policy"] == ("Transient Local" if latched else "Volatile")
            assert entry["Reliability Policy"] == "Reliable"


@pytest.mark.parametrize(
    ("file", "commands"),
    [
        ("replay.launch.py", ["replay"]),
        ("live.launch.py", ["live", "record"]),
        ("rviz.launch.py", []),
    ],
)
def test_launch_files_run_valid_command_lines(project_root, file, commands):
    text = (project_root / "launch" / file).read_text()
    tree = ast.parse(text)
    lines = [
        node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "cmd"
    ]
    assert len(lines) == len(commands)
    for line, command in zip(lines, commands, strict=True):
        assert isinstance(line, ast.List)
        # A launch configuration is replaced by "1", which is valid as a case and as a rate.
        arguments = [item.value if isinstance(item, ast.Constant) else "1" for item in line.elts]
        assert build_parser().parse_args(arguments[1:]).command == command
    declared = set(re.findall(r"DeclareLaunchArgument\(\s*\"(\w+)\"", text))
    assert set(re.findall(r"LaunchConfiguration\(\"(\w+)\"\)", text)) == declared
    for name in re.findall(r"\"(\w+\.launch\.py)\"", text):
        assert (project_root / "launch" / name).is_file()
    for name in re.findall(r"\"rviz\" / \"([^\"]+)\"", text):
        assert (project_root / "rviz" / name).is_file()


def test_ros_package_installs_existing_folders_and_hides_no_other_package(project_root):
    folder = project_root / "ros" / "marginguard"
    package = ElementTree.parse(folder / "package.xml").getroot()
    assert package.findtext("name") == "marginguard"
    (names,) = re.findall(r"foreach\(folder ([^)]*)\)", (folder / "CMakeLists.txt").read_text())
    for name in names.split():
        assert (project_root / name).is_dir()
    # colcon does not search below a folder with a package.xml.
    assert not (project_root / "package.xml").exists()
    assert not (project_root / "ros" / "package.xml").exists()


def test_foxglove_layout_uses_published_topics(project_root):
    layout = json.loads((project_root / "foxglove" / "marginguard.json").read_text())
    panels = layout["configById"]

    def panels_of(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
            return
        assert node["direction"] in {"row", "column"}
        assert 0 < node["splitPercentage"] < 100
        for part in ("first", "second"):
            yield from panels_of(node[part])

    assert sorted(panels_of(layout["layout"])) == sorted(panels)
    assert {name.partition("!")[0] for name in panels} >= {
        "3D",
        "Plot",
        "StateTransitions",
        "DiagnosticSummary",
    }
    states = ", ".join(f"{state.value} {state.name.lower()}" for state in MarginState)
    assert panels["StateTransitions!state"]["foxglovePanelTitle"] == f"Margin state: {states}"
    used = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    used += [panel["topicPath"] for panel in panels.values() if "topicPath" in panel]
    assert used
    for path in used:
        topic, field, *_ = path.split(".")
        assert field in PUBLISHED[topic].type.get_fields_and_field_types(), path
    assert set(panels["3D!margin"]["topics"]) <= PUBLISHED.keys()
    assert panels["DiagnosticSummary!all"]["topicToRender"] in PUBLISHED
