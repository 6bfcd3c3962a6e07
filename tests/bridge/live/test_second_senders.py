"""``marginguard live`` beside a second sender of each of its inputs, in separate processes."""

import signal
import threading
import time
from functools import partial
from pathlib import Path

import pytest
from marginguard_msgs.msg import FixtureConstraint
from marginguard_msgs.srv import NeedleCorridors

from app.bridge import RosNode, guard_scene, plan_execution, planning_server
from app.bridge.calls.service_client import ServiceClient
from app.bridge.obstacles import Obstacles
from app.control import open_control
from tests.bridge.conftest import TF, TRACKED
from tests.bridge.live.guard_monitor import monitored
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.long

HERE = Path(__file__).resolve().parent
SENDER, RIVAL = HERE / "sender.py", HERE / "rival.py"
UNKNOWN = FixtureConstraint.UNKNOWN


@pytest.fixture
def guarded(start_live, start_sender, live_yaml, domain_id):
    """``guarded(kind)`` starts a guard and a tracker; returns the guard and the tracker."""

    def begin(kind):
        config = live_yaml(TF if kind == "tf" else TRACKED)
        return start_live(config), start_sender(kind, "again")

    return begin


def rival_begins(rival):
    rival.send("go")
    return int(rival.line(lambda line: line.startswith("begun")).split()[1])


def names_rival(text, received):
    """The name of a node may become known some time after its first message."""
    return any(text in cause and "/rival" in cause for cause in received.message.hold_causes)


@pytest.mark.parametrize(
    ("kind", "rivals"),
    [
        ("tf", {"tf": "tracker -> cautery on /tf", "static": "reference -> robot_base on"}),
        ("tracked", {"tracked": "tracker -> cautery on /tracked_transforms"}),
        ("tracked", {"joints": "joints on /joint_states", "constraint": "/marginguard/constraint"}),
    ],
)
def test_second_sender_is_a_fault_until_it_has_ended(
    guarded, start, frames_file, domain_id, kind, rivals
):
    guard, _ = guarded(kind)
    with monitored(domain_id) as monitor:
        for what, text in rivals.items():
            monitor.make_permissive()
            rival = start(RIVAL, str(frames_file), what)
            rival.line(lambda line: line == "ready\n")
            fault = monitor.until(lambda each: each.has_second_sender, rival_begins(rival))
            monitor.until(partial(names_rival, text), fault.at_ns)
            rival.send("end")
            assert rival.wait() == 0
            ended = monitor.until(lambda each: not each.has_second_sender)
            monitor.until(lambda each: each.message.state != UNKNOWN)
            assert not any(each.is_permissive for each in monitor.since(fault.at_ns))
            assert ended.message.hold
        monitor.make_permissive()
    assert all(text in guard.log.read_text() for text in rivals.values())


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT], ids=["killed", "interrupted"])
def test_restarted_tracker_is_no_second_sender(start_sender, guarded, domain_id, number):
    _, tracker = guarded("tf")
    with monitored(domain_id) as monitor:
        for _ in range(3):
            monitor.make_permissive()
            tracker.end(number)
            stale = monitor.until(lambda each: "stale" in each.message.reasons)
            tracker = start_sender("tf", "again")
            monitor.until(lambda each: "stale" not in each.message.reasons, stale.at_ns)
        monitor.make_permissive()
        assert not any(each.has_second_sender for each in monitor.received)


def test_joints_of_another_device_on_the_robots_topic_are_no_fault(
    guarded, start, frames_file, domain_id
):
    guarded("tracked")
    with monitored(domain_id) as monitor:
        rival = start(RIVAL, str(frames_file), "gripper")
        rival.line(lambda line: line == "ready\n")
        begun_ns = rival_begins(rival)
        monitor.make_permissive()
        permissive_ns = monitor.until(lambda each: each.is_permissive).at_ns
        monitor.until(lambda each: each.at_ns > permissive_ns + 10**9)
        reasons = {each for seen in monitor.since(permissive_ns) for each in seen.message.reasons}
        assert not reasons & {"second_sender", "redundancy_lost"}
        assert not any(each.has_second_sender for each in monitor.since(begun_ns))


def test_nothing_is_planned_by_the_poses_of_two_senders(
    guarded, start, frames_file, domain_id, project_root, monkeypatch
):
    monkeypatch.setattr(guard_scene, "WAIT_S", 1.0)
    guarded("tracked")
    description = open_control(project_root / "data" / "worlds" / "lumpectomy")
    with (
        monitored(domain_id) as monitor,
        RosNode(planning_server.NODE_NAME, domain_id=domain_id) as ros,
        RosNode("peer", domain_id=domain_id) as peer,
    ):
        arm = plan_execution.ExecutionNode(ros, description, clock_ns=time.time_ns)
        guard = guard_scene.GuardScene(ros, description, Obstacles(ros))
        planning_server.PlanningServer(ros, description, arm, guard, threading.Lock())
        name = "/marginguard_plan/needle_corridors"
        corridors = ServiceClient(peer, NeedleCorridors, name)
        request = NeedleCorridors.Request(
            entry_radius=0.02, length=0.3, diameter=0.001, bend=0.0, sigma=0.0005
        )
        request.entry.header.frame_id = "needle"
        request.entry.pose.position.z, request.entry.pose.orientation.w = 0.08, 1.0
        monitor.make_permissive()
        trusted = corridors.call(request, DEADLINE_S)
        assert (trusted.message, trusted.success) == ("", True)
        rival = start(RIVAL, str(frames_file), "tracked")
        rival.line(lambda line: line == "ready\n")
        monitor.until(lambda each: each.has_second_sender, rival_begins(rival))
        refused = corridors.call(request, DEADLINE_S)
    assert (refused.success, refused.plan) == (False, "")
    assert refused.message.startswith("margin: is UNKNOWN (second_sender")
