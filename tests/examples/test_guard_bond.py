"""The bond example with a lifecycle controller and a guard that is killed, stopped and ended."""

import runpy
import signal
import threading
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from lifecycle_msgs.msg import Transition  # noqa: E402
from lifecycle_msgs.srv import ChangeState  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from app.bridge.control.lifecycle import LifecycleRosNode  # noqa: E402
from tests.bridge.live.conftest import live_yaml as live_yaml  # noqa: E402
from tests.bridge.live.conftest import start as start  # noqa: E402
from tests.bridge.live.restarts import TRACKED, live  # noqa: E402
from tests.ros_domain import domain_id as domain_id  # noqa: E402
from tests.waiting import wait_until  # noqa: E402

pytestmark = pytest.mark.long

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "controller" / "guard_bond.py"
NS_PER_MS = 1_000_000


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


class Controller:
    """Test double of a controller: `active` is set while it may move the robot."""

    def __init__(self):
        self.active = threading.Event()

    def configure(self, ros):
        pass

    def activate(self):
        self.active.set()

    def deactivate(self):
        self.active.clear()

    def clean_up(self):
        pass


def test_bond_breaks_by_silence_replacement_and_end_and_stays_broken(example):
    bond = example["Bond"](timeout_ns=100 * NS_PER_MS)
    bond.check(10**12)
    bond.receive("old", True, 10**12)  # the last constraint of an earlier guard forms no bond
    assert (bond.instance_id, bond.broken) == ("", "")
    bond.receive("a", False, 10**12)
    bond.check(10**12 + 100 * NS_PER_MS)
    assert (bond.instance_id, bond.broken) == ("a", "")
    bond.check(10**12 + 101 * NS_PER_MS)
    assert bond.broken == "the guard has been silent for 101 ms"
    bond.receive("a", False, 10**12 + 102 * NS_PER_MS)
    assert bond.broken == "the guard has been silent for 101 ms"
    bond.form()
    bond.receive("a", False, 2 * 10**12)
    bond.receive("b", False, 2 * 10**12)
    assert bond.broken == "another guard sends, b"
    bond.form()
    bond.receive("b", False, 3 * 10**12)
    bond.receive("b", True, 3 * 10**12)
    assert bond.broken == "the guard has ended"
    # A heartbeat after a silence does not hide it, although no check came between.
    bond.form()
    bond.receive("c", False, 4 * 10**12)
    bond.receive("c", False, 5 * 10**12)
    assert bond.broken.startswith("the guard has been silent")


@pytest.fixture
def graph(example, domain_id):
    """The example's node and an executor that spins it, with an active lifecycle controller."""
    rclpy.init()
    controller = Controller()
    with LifecycleRosNode("my_controller", controller, domain_id=domain_id):
        node = example["GuardBond"]("/my_controller")
        node.bond.timeout_ns = 2000 * NS_PER_MS  # a busy machine delays heartbeats
        yield node, controller
        node.destroy_node()
    rclpy.shutdown()


def spin_until(node, condition):
    def spin():
        rclpy.spin_once(node, timeout_sec=0.1)

    wait_until(condition, spin, pause_s=0.0, describe=lambda: node.state)


def call(node, kind, name, request):
    client = node.create_client(kind, name)
    spin_until(node, client.service_is_ready)
    reply = client.call_async(request)
    spin_until(node, reply.done)
    assert reply.result().success


def change(node, *transitions):
    for transition in transitions:
        request = ChangeState.Request(transition=Transition(id=transition))
        call(node, ChangeState, "/my_controller/change_state", request)


def form_and_activate(node, controller):
    call(node, Trigger, "/guard_bond/form", Trigger.Request())
    spin_until(node, lambda: node.state.startswith("bond to guard"))
    change(node, Transition.TRANSITION_ACTIVATE)
    assert controller.active.is_set()


def test_controller_is_inactive_after_its_guard_was_stopped_killed_or_ended(
    graph, start, live_yaml
):
    node, controller = graph
    config = live_yaml(TRACKED)
    change(node, Transition.TRANSITION_CONFIGURE)
    guard = start(*live(config))
    form_and_activate(node, controller)
    first = node.bond.instance_id

    guard.process.send_signal(signal.SIGSTOP)
    spin_until(node, lambda: not controller.active.is_set())
    assert "silent" in node.state
    guard.process.send_signal(signal.SIGCONT)
    for _ in range(20):
        rclpy.spin_once(node, timeout_sec=0.1)
    assert not controller.active.is_set()  # the bond stays broken

    form_and_activate(node, controller)
    guard.end(signal.SIGKILL)
    spin_until(node, lambda: not controller.active.is_set())
    assert "silent" in node.state

    guard = start(*live(config))
    guard.line(lambda line: line.startswith("UNKNOWN"))
    form_and_activate(node, controller)
    assert node.bond.instance_id != first
    guard.process.send_signal(signal.SIGTERM)  # without a pause, which would be taken for silence
    spin_until(node, lambda: not controller.active.is_set())
    assert node.state == "the guard has ended"
