"""A simulated world with guard and controller, started in one line, against an operator's node."""

import os
import re
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from app.bridge import RosNode
from app.bridge.qos import STREAM, Topic
from app.cli.main import main
from app.fixture import ProximityEngine
from app.geometry import Transform
from app.simulation import open_world
from benchmarks.closed_loop.loop_operator import Operator
from tests.bridge.live.conftest import DEADLINE_S
from tests.waiting import wait_until

pytestmark = pytest.mark.long

STOP_MM = 1.0


class Judge(Operator):
    """The operator, which also records the true poses of tumour and tool."""

    def __init__(self, ros):
        super().__init__(ros)
        self.poses = []
        ros.subscribe(Topic("/tf", TFMessage, STREAM), self._take_tf)

    def distances(self, engine):
        return [
            engine.evaluate(tumor.inverse() @ tool).signed_distance_mm
            for tumor, tool in list(self.poses)
        ]

    def wait_until(self, condition):
        assert self.until(condition, DEADLINE_S), f"not within {DEADLINE_S} s: {self.texts()}"

    def _take_tf(self, message):
        found = {each.child_frame_id: pose(each) for each in message.transforms}
        if "truth/tumor" in found:
            self.poses.append((found["truth/tumor"], found["truth/cautery"]))


def pose(message):
    place, turn = message.transform.translation, message.transform.rotation
    name = message.child_frame_id.removeprefix("truth/").replace("cautery", "tool")
    return Transform.from_quaternion(
        (turn.x, turn.y, turn.z, turn.w),
        1000.0 * np.array([place.x, place.y, place.z]),
        target="world",
        source=name,
    )


@pytest.fixture
def operator(domain_id):
    with RosNode("operator", domain_id=domain_id) as ros:
        yield Judge(ros)


@pytest.fixture
def group(start, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    child = start("-m", "app.cli", "simulate", str(world), "--with", "live", "--with", "control")
    child.line(lambda line: line.startswith("SIMULATION"))
    return child


def children_of(pid):
    """Command and id of the processes whose parent is ``pid``."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            words = (stat.parent / "cmdline").read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile
            continue
        if parent == pid and b"app.cli.child_of_command" in words:
            found[words[4].decode()] = int(stat.parent.name)
    return found


def wait_until_ended(pids):
    wait_until(lambda: not any(map(running, pids)), describe=lambda: f"{pids} still run")


def running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_hand_moves_the_tool_towards_the_tumour_and_one_signal_ends_all(
    group, operator, project_root
):
    description = open_world(project_root / "data" / "worlds" / "lumpectomy")
    tool, tumor = description.robots[0].tool.mesh, description.tissues[0].mesh
    engine = ProximityEngine(replace(tumor, frame="tumor"), replace(tool, frame="tool"))
    children = children_of(group.process.pid)
    assert set(children) == {"live", "control"}

    def is_near():
        if not operator.poses:
            return False
        tumor_pose, tool_pose = operator.poses[-1]
        away = tumor_pose.translation_mm - tool_pose.translation_mm
        return np.linalg.norm(away) < 45.0

    operator.wait_until(is_near)  # 58 mm at the start
    operator.wait_until(lambda: len(operator.poses) > 10)
    assert min(operator.distances(engine)) >= STOP_MM
    assert group.end(signal.SIGINT) == 130
    wait_until_ended(children.values())


def test_killed_controller_stops_the_arm_and_ends_the_others(group, operator):
    children = children_of(group.process.pid)
    operator.wait_until(lambda: operator.state("control /arm") == "follows")
    os.kill(children["control"], signal.SIGKILL)
    assert group.process.wait(DEADLINE_S) == 2
    assert "'marginguard control' ended with status -9" in group.log.read_text()
    wait_until_ended(children.values())


def test_killed_simulation_leaves_no_process(group):
    children = children_of(group.process.pid)
    assert set(children) == {"live", "control"}
    group.process.kill()
    wait_until_ended(children.values())


def test_page_is_the_guard_and_ends_with_the_simulation(start, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    group = start("-m", "app.cli", "simulate", str(world), "--with", "live", "--view")
    assert group.line(lambda line: line.startswith("view: http")).count("token=") == 1
    group.line(lambda line: line.startswith("SIMULATION"))
    children = children_of(group.process.pid)
    assert set(children) == {"view"}
    assert group.end(signal.SIGINT) == 130
    wait_until_ended(children.values())


def test_missing_file_of_a_command_is_named(tmp_path, capsys, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy" / "world.yaml"
    (tmp_path / "world.yaml").write_text(world.read_text())
    assert main(["simulate", str(tmp_path), "--with", "control"]) == 2
    (line,) = [each for each in capsys.readouterr().err.splitlines() if "error" in each]
    assert re.search(r"control\.yaml: no such file; expected it beside the world", line)
