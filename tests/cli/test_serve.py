"""``marginguard serve`` in one process, with a client of plain rclpy in another."""

import json
import math
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from app.bridge.calls import ActionClient, GoalAbortedError
from app.bridge.node import RosNode
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE
from tests.bridge.conftest import domain_id as domain_id
from tests.bridge.conftest import start_receiver as start_receiver
from tests.cli.small_case import FRAMES, write_small_case

BRIDGE = Path(__file__).resolve().parents[1] / "bridge"
SENDER, CALLER = BRIDGE / "calls" / "goal_sender.py", BRIDGE / "caller.py"
CYCLONE_SENDER = BRIDGE / "cyclone_goal_sender.py"
TOOL = BRIDGE / "calls" / "tool_sender.py"
REPLAY = "marginguard_msgs/action/Replay"
LOAD_CASE = "marginguard_msgs/srv/LoadCase"


@pytest.fixture
def served(domain_id, tmp_path):
    write_small_case(tmp_path / "small")
    command = [sys.executable, "-m", "app.cli", "serve", "--cases", str(tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr:
            if "serves cases below" in line:
                break
        yield process
        process.kill()


def send(start_receiver, *goals):
    goals = [json.dumps({"rate": math.inf, "end": math.inf, **goal}) for goal in goals]
    receiver = start_receiver("/marginguard_server/replay", REPLAY, *goals, script=SENDER)
    return receiver.messages()


def test_replay_for_another_process(served, start_receiver):
    whole, part, again = send(
        start_receiver,
        {"case_folder": "small"},
        {"case_folder": "small", "start": 0.5, "end": 1.0},
        {"rate": 0.0},
    )
    assert whole["status"] == "succeeded"
    assert whole["result"]["frames"] == FRAMES
    assert whole["result"]["breaches"] == 1
    # The rod's side passes the ball 3 mm deep.
    assert whole["result"]["min_signed_distance"] == pytest.approx(-0.003, abs=0.0003)
    assert whole["last"]["frames"] == FRAMES
    assert whole["last"]["time"] == pytest.approx(whole["last"]["duration"])
    assert part["result"]["frames"] == 11
    # The case stays open; a rate of 0 is refused with the player's reason.
    assert again["status"] == "aborted"
    assert "rate of a replay is 0.0" in again["result"]["message"]


def test_replay_in_real_time_is_cancelled(served, start_receiver):
    (reply,) = send(start_receiver, {"case_folder": "small", "rate": 0.01, "cancel_after": 1})
    assert reply["status"] == "cancelled"
    assert not reply["result"]["success"]
    # At 0.05 frames a second the second frame was not waited for.
    assert reply["result"]["frames"] == 1


def test_cyclone_dds_replays_and_cancels(served, start_receiver):
    whole = {"case_folder": "small", "rate": math.inf, "start": 0.0, "end": math.inf}
    slow = {**whole, "rate": 0.01, "cancel": True}
    sender = start_receiver(
        "/marginguard_server/replay",
        "Replay",
        json.dumps(whole),
        json.dumps(slow),
        script=CYCLONE_SENDER,
        environment=CYCLONE_ON_THIS_MACHINE,
    )
    played, cancelled = sender.messages()
    executing, succeeded, is_cancelled = 2, 4, 5  # action_msgs/GoalStatus

    assert played["first"]["duration"] == pytest.approx(0.05 * (FRAMES - 1))
    assert (played["status"], played["states"][-1]) == (succeeded, succeeded)
    assert played["states"] == sorted(played["states"])
    assert played["result"] == {
        "success": True,
        "message": "",
        "frames": FRAMES,
        "breaches": 1,
        "min_signed_distance": pytest.approx(-0.003, abs=0.0003),
    }

    assert cancelled["first"]["frames"] == 1
    assert cancelled["cancel"] == {"return_code": 0, "own": [True]}
    assert (cancelled["status"], cancelled["states"][-1]) == (is_cancelled, is_cancelled)
    assert executing in cancelled["states"]
    assert not cancelled["result"]["success"]
    assert cancelled["result"]["message"] == "cancelled after 1 frames"


def test_cyclone_dds_calibrates_and_cancels(served, start_receiver):
    start_receiver("pivot", script=TOOL)
    goal = {"method": 0, "frame": "stylus", "parent_frame": "reference", "timeout": 30.0}
    goals = ({**goal, "samples": 60}, {**goal, "samples": 10_000, "cancel": True})
    sender = start_receiver(
        "/marginguard_server/calibrate",
        "Calibrate",
        *map(json.dumps, goals),
        script=CYCLONE_SENDER,
        environment=CYCLONE_ON_THIS_MACHINE,
    )
    found, cancelled = sender.messages()
    succeeded, is_cancelled = 4, 5  # action_msgs/GoalStatus

    assert (found["status"], found["states"][-1]) == (succeeded, succeeded)
    assert (found["result"]["success"], found["result"]["samples"]) == (True, 60)
    tip = found["result"]["transform"]
    assert (tip["header"]["frame_id"], tip["child_frame_id"]) == ("stylus", "stylus_tip")
    place = [tip["transform"]["translation"][axis] for axis in "xyz"]
    assert place == pytest.approx([0.005, 0.0126, 0.1033], abs=0.0001)

    assert "pivot the tool about its tip" in cancelled["first"]["hint"]
    assert cancelled["cancel"] == {"return_code": 0, "own": [True]}
    assert (cancelled["status"], cancelled["states"][-1]) == (is_cancelled, is_cancelled)
    assert not cancelled["result"]["success"]
    assert "cancelled after" in cancelled["result"]["message"]


def test_cases_outside_the_folder_are_refused(served, start_receiver):
    folders = ["/etc", "../small", "nowhere", "", "small"]
    requests = [
        f"/marginguard_server/load_case:{LOAD_CASE}:{json.dumps({'case_folder': name})}"
        for name in folders
    ]
    replies = start_receiver(*requests, script=CALLER).messages()
    assert [reply["success"] for reply in replies] == [False] * 4 + [True]
    assert all(reply["message"] for reply in replies[:4])
    assert (replies[4]["name"], replies[4]["frames"]) == ("small", FRAMES)
    assert replies[4]["duration"] == pytest.approx(0.05 * (FRAMES - 1))
    (outside,) = send(start_receiver, {"case_folder": "../small"})
    assert outside["status"] == "aborted"
    assert "'../small'" in outside["result"]["message"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_command(served, number):
    os.kill(served.pid, number)
    assert served.wait(30.0) == 0


def test_signal_ends_replay_and_its_result_is_sent(served, domain_id):
    under_way = threading.Event()
    with RosNode("follower", domain_id=domain_id) as ros:
        client = ActionClient(ros, REPLAY, "/marginguard_server/replay")
        goal = client.start(
            {"case_folder": "small", "rate": 0.01, "end": math.inf},
            30.0,
            feedback=lambda _: under_way.set(),
        )
        assert under_way.wait(120.0)  # compiles kernels in a new checkout
        served.send_signal(signal.SIGTERM)
        with pytest.raises(GoalAbortedError, match="cancelled after 1 frames"):
            goal.result(30.0)
    assert served.wait(30.0) == 0
