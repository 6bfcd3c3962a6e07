"""``marginguard serve`` in one process, with a client of plain rclpy in another."""

import json
import math
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.bridge.calls import ActionClient, GoalAbortedError
from app.bridge.node import RosNode
from tests.bridge.conftest import CYCLONE_ON_THIS_MACHINE
from tests.bridge.conftest import start_receiver as start_receiver
from tests.cli.small_case import FRAMES, write_small_case
from tests.forking import forked
from tests.ros_domain import domain_in_environment

pytestmark = pytest.mark.long

BRIDGE = Path(__file__).resolve().parents[1] / "bridge"
SENDER, CALLER = BRIDGE / "calls" / "goal_sender.py", BRIDGE / "caller.py"
CYCLONE_SENDER = BRIDGE / "cyclone_goal_sender.py"
TOOL = BRIDGE / "calls" / "tool_sender.py"
REPLAY = "marginguard_msgs/action/Replay"
LOAD_CASE = "marginguard_msgs/srv/LoadCase"
EXECUTING, SUCCEEDED, CANCELLED = 2, 4, 5
"""Values of action_msgs/GoalStatus."""

WHOLE = {"case_folder": "small", "rate": math.inf, "start": 0.0, "end": math.inf}


@pytest.fixture(scope="module")
def domain_id():
    """One ROS domain for all tests of this file."""
    with domain_in_environment() as domain:
        yield domain


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases")
    write_small_case(folder / "small")
    return folder


@contextmanager
def server(cases):
    with forked("-m", "app.cli", "serve", "--cases", cases) as process:
        for line in process.stderr:
            if "serves cases below" in line:
                break
        yield process


@pytest.fixture(scope="module")
def served(domain_id, cases):
    """A server for all tests that do not end it."""
    with server(cases) as process:
        yield process


@pytest.fixture
def send(served, start_receiver):
    """``send(goal, ...)``: the outcomes of goals for a replay, by plain rclpy."""

    def run(*goals):
        goals = [json.dumps({"rate": math.inf, "end": math.inf, **goal}) for goal in goals]
        receiver = start_receiver("/marginguard_server/replay", REPLAY, *goals, script=SENDER)
        return receiver.messages()

    return run


@pytest.fixture
def send_by_cyclone(served, start_receiver):
    """``send_by_cyclone(action, goal, ...)``: the same by Cyclone DDS without ROS."""

    def run(action, *goals):
        name, kind = f"/marginguard_server/{action}", action.title()
        options = {"script": CYCLONE_SENDER, "environment": CYCLONE_ON_THIS_MACHINE}
        return start_receiver(name, kind, *map(json.dumps, goals), **options).messages()

    return run


def assert_cancelled(outcome):
    assert outcome["cancel"] == {"return_code": 0, "own": [True]}
    assert (outcome["status"], outcome["states"][-1]) == (CANCELLED, CANCELLED)
    assert not outcome["result"]["success"]


def test_replay_for_another_process(send):
    whole, part, again = send(
        {"case_folder": "small"}, {"case_folder": "small", "start": 0.5, "end": 1.0}, {"rate": 0.0}
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


def test_replay_in_real_time_is_cancelled(send):
    (reply,) = send({"case_folder": "small", "rate": 0.01, "cancel_after": 1})
    assert reply["status"] == "cancelled"
    assert not reply["result"]["success"]
    # At 0.05 frames a second the second frame was not waited for.
    assert reply["result"]["frames"] == 1


def test_cyclone_dds_replays_and_cancels(send_by_cyclone):
    played, cancelled = send_by_cyclone("replay", WHOLE, {**WHOLE, "rate": 0.01, "cancel": True})
    assert played["first"]["duration"] == pytest.approx(0.05 * (FRAMES - 1))
    assert (played["status"], played["states"][-1]) == (SUCCEEDED, SUCCEEDED)
    assert played["states"] == sorted(played["states"])
    assert played["result"] == {
        "success": True,
        "message": "",
        "frames": FRAMES,
        "breaches": 1,
        "min_signed_distance": pytest.approx(-0.003, abs=0.0003),
    }
    assert_cancelled(cancelled)
    assert cancelled["first"]["frames"] == 1
    assert EXECUTING in cancelled["states"]
    assert cancelled["result"]["message"] == "cancelled after 1 frames"


def test_cyclone_dds_calibrates_and_cancels(send_by_cyclone, start_receiver):
    start_receiver("pivot", script=TOOL)
    goal = {"method": 0, "frame": "stylus", "parent_frame": "reference", "timeout": 30.0}
    goals = ({**goal, "samples": 60}, {**goal, "samples": 10_000, "cancel": True})
    found, cancelled = send_by_cyclone("calibrate", *goals)
    assert (found["status"], found["states"][-1]) == (SUCCEEDED, SUCCEEDED)
    assert (found["result"]["success"], found["result"]["samples"]) == (True, 60)
    tip = found["result"]["transform"]
    assert (tip["header"]["frame_id"], tip["child_frame_id"]) == ("stylus", "stylus_tip")
    place = [tip["transform"]["translation"][axis] for axis in "xyz"]
    assert place == pytest.approx([0.005, 0.0126, 0.1033], abs=0.0001)
    assert_cancelled(cancelled)
    assert "pivot the tool about its tip" in cancelled["first"]["hint"]
    assert "cancelled after" in cancelled["result"]["message"]


def test_cases_outside_the_folder_are_refused(send, start_receiver):
    requests = [
        f"/marginguard_server/load_case:{LOAD_CASE}:{json.dumps({'case_folder': name})}"
        for name in ("/etc", "../small", "nowhere", "", "small")
    ]
    replies = start_receiver(*requests, script=CALLER).messages()
    assert [reply["success"] for reply in replies] == [False] * 4 + [True]
    assert all(reply["message"] for reply in replies[:4])
    assert (replies[4]["name"], replies[4]["frames"]) == ("small", FRAMES)
    assert replies[4]["duration"] == pytest.approx(0.05 * (FRAMES - 1))
    (outside,) = send({"case_folder": "../small"})
    assert outside["status"] == "aborted"
    assert "'../small'" in outside["result"]["message"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_command(cases, number):
    with domain_in_environment(), server(cases) as process:
        process.send_signal(number)
        assert process.wait() == 0


def test_signal_ends_replay_and_its_result_is_sent(cases):
    under_way = threading.Event()
    with domain_in_environment() as domain, server(cases) as process:
        with RosNode("follower", domain_id=domain) as ros:
            client = ActionClient(ros, REPLAY, "/marginguard_server/replay")
            fields = {"case_folder": "small", "rate": 0.01, "end": math.inf}
            goal = client.start(fields, 60.0, feedback=lambda _: under_way.set())
            assert under_way.wait(120.0)  # compiles kernels in a new checkout
            process.send_signal(signal.SIGTERM)
            with pytest.raises(GoalAbortedError, match="cancelled after 1 frames"):
                goal.result(60.0)
        assert process.wait() == 0
