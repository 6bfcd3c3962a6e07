"""A simulated world with guard and controller, started in one line, against an operator's node."""

import os
import re
import signal
from pathlib import Path

import numpy as np
import pytest

from tests.bridge.live.conftest import DEADLINE_S
from tests.cli.command import run
from tests.cli.test_page_push import STOP_MM, tumor_from_tool
from tests.cli.test_page_push import judge as judge
from tests.waiting import wait_until

pytestmark = pytest.mark.long


def wait_for(judge, condition):
    assert judge.until(condition, DEADLINE_S), f"not within {DEADLINE_S} s: {judge.texts()}"


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
        if parent == pid and b"app.cli.child_commands" in words:
            found[words[4].decode()] = int(stat.parent.name)
    return found


def wait_until_ended(pids):
    wait_until(lambda: not any(map(running, pids)), describe=lambda: f"{pids} still run")


def running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_hand_moves_the_tool_towards_the_tumour_and_one_signal_ends_all(group, judge):
    children = children_of(group.process.pid)
    assert set(children) == {"live", "control"}

    def is_near():
        away = [tumor_from_tool(data).translation_mm for data in judge.truth[-1:]]
        return bool(away) and np.linalg.norm(away) < 45.0

    wait_for(judge, is_near)  # 58 mm at the start
    wait_for(judge, lambda: len(judge.truth) > 10)
    assert min(judge.distances_mm()) >= STOP_MM
    assert group.end(signal.SIGINT) == 130
    wait_until_ended(children.values())


def test_killed_controller_stops_the_arm_and_ends_the_others(group, judge):
    children = children_of(group.process.pid)
    wait_for(judge, lambda: judge.state("control /arm") == "follows")
    os.kill(children["control"], signal.SIGKILL)
    assert group.process.wait(DEADLINE_S) == 2
    assert "'marginguard control' ended with status -9" in group.log.read_text()
    wait_until_ended(children.values())


def test_killed_simulation_leaves_no_process(group):
    children = children_of(group.process.pid)
    assert set(children) == {"live", "control"}
    group.process.kill()
    wait_until_ended(children.values())


def test_guard_and_page_are_two_processes_and_end_with_the_simulation(start, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy"
    group = start("-m", "app.cli", "simulate", str(world), "--with", "live", "--view")
    assert group.line(lambda line: line.startswith("view: http")).count("token=") == 1
    group.line(lambda line: line.startswith("SIMULATION"))
    children = children_of(group.process.pid)
    assert set(children) == {"live", "view"}
    assert group.end(signal.SIGINT) == 130
    wait_until_ended(children.values())


def test_missing_file_of_a_command_is_named(tmp_path, project_root):
    world = project_root / "data" / "worlds" / "lumpectomy" / "world.yaml"
    (tmp_path / "world.yaml").write_text(world.read_text())
    error = run("simulate", tmp_path, "--with", "control", status=2).err
    (line,) = [each for each in error.splitlines() if "error" in each]
    assert re.search(r"control\.yaml: no such file; expected it beside the world", line)
