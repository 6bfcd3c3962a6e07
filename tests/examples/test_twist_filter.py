"""The controller example against a real live session, which is killed and started again."""

import runpy
import signal

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from app.fixture import LimiterParameters  # noqa: E402
from tests.bridge.live.conftest import breach as breach  # noqa: E402
from tests.bridge.live.conftest import frames_file as frames_file  # noqa: E402
from tests.bridge.live.conftest import live_yaml as live_yaml  # noqa: E402
from tests.bridge.live.conftest import start as start  # noqa: E402
from tests.bridge.live.test_live_command import SENDER, TRACKED  # noqa: E402
from tests.ros_domain import domain_id as domain_id  # noqa: E402
from tests.waiting import wait_until  # noqa: E402

pytestmark = pytest.mark.long

STEPS = 200
PARAMETERS = LimiterParameters()


@pytest.fixture
def graph(domain_id, project_root):
    """Nodes of the example in this process, spun by `spin_until`."""
    folder = project_root / "examples" / "controller"
    twist_filter = runpy.run_path(str(folder / "twist_filter.py"))["TwistFilter"]
    push = runpy.run_path(str(folder / "push.py"))["Push"]

    class Recorded(twist_filter):
        """Keeps every published twist with the message and the time of its decision."""

        def __init__(self, frame):
            super().__init__(frame, accept_simulated=True)
            self.steps = []
            self.decided_ns = None
            publish, allow = self.safe.publish, self.rule.allow

            def decide(desired, tip_mm, now_ns):
                self.decided_ns = now_ns
                return allow(desired, tip_mm, now_ns)

            def record(message):
                v, w = message.twist.linear, message.twist.angular
                twist = np.array([1e3 * v.x, 1e3 * v.y, 1e3 * v.z, w.x, w.y, w.z])
                tip_mm = None if self.tip is None else self.tip[1]
                self.steps.append((self.logged, twist, tip_mm, self.rule.message, self.decided_ns))
                publish(message)

            self.safe.publish, self.rule.allow = record, decide

    rclpy.init()
    nodes = [Recorded("tumor"), push()]
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    yield executor, *nodes
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown()


def spin_until(executor, condition):
    wait_until(condition, lambda: executor.spin_once(timeout_sec=0.1), pause_s=0.0)


def reasons(controller):
    return [step[0] for step in controller.steps]


def assert_within_planes(steps):
    """No twist violates a plane of the message that was in use, computed from its values here."""
    assert steps
    for reason, twist, tip_mm, message, now_ns in steps:
        if reason in ("allowed", "hold"):
            assert now_ns < message.valid_until_ns
            n, p = message.normals, message.points_on_tool_mm
            velocities = twist[:3] + np.cross(twist[3:], p - tip_mm)
            clearances = (n * p).sum(axis=1) - message.offsets_mm
            lower = np.minimum(-clearances / PARAMETERS.tau_s, 0.0)
            lower = lower if reason == "allowed" else np.zeros_like(lower)
            tumor = (n * message.tumor_velocities_mm_s).sum(axis=1)
            # The rule turns the points about the tip at the time of the planes, 15 mm away at most.
            slack = 1e-5 + 15.0 * np.linalg.norm(twist[3:])
            assert ((n * velocities).sum(axis=1) >= lower + tumor - slack).all(), reason
        else:
            assert not twist.any(), reason


@pytest.mark.parametrize(
    ("age_ns", "reason"),
    [(-1_000_000_000, "no_command"), (0, "no_message"), (1_000_000_000, "no_command")],
)
def test_command_that_is_old_or_ahead_of_the_clock_is_no_motion(graph, monkeypatch, age_ns, reason):
    _, controller, _ = graph
    now_ns = controller.now_ns()
    monkeypatch.setattr(controller, "now_ns", lambda: now_ns)
    controller.desired = (now_ns - age_ns, np.ones(6))
    controller.tip = (now_ns - age_ns, np.zeros(3))
    controller.step()
    assert controller.logged == reason


def test_controller_keeps_planes_stops_without_guard_and_holds_for_a_new_one(
    graph, start, live_yaml, frames_file
):
    executor, controller, push = graph
    config = str(live_yaml(TRACKED))
    guard = start("-m", "app.cli", "live", "--constraint-hz", "100", "--config", config)
    guard.line(lambda line: line.startswith("UNKNOWN"))
    sender = start(str(SENDER), str(frames_file), "tracked", "again")
    spin_until(executor, lambda: reasons(controller).count("allowed") >= STEPS)
    first = controller.rule.instance_id
    limited = [step for step in controller.steps if step[0] == "allowed"]
    speeds = [float(np.linalg.norm(step[1][:3])) for step in limited]
    assert min(speeds) < 45.0  # the push of 50 mm/s was limited

    guard.end(signal.SIGKILL)
    killed = len(controller.steps)
    spin_until(executor, lambda: {"silent", "expired"} & set(reasons(controller)[killed:]) != set())
    after = controller.steps[killed:]
    lost = next(i for i, step in enumerate(after) if step[0] in ("silent", "expired"))
    assert not any(step[1].any() for step in after[lost:])

    start("-m", "app.cli", "live", "--constraint-hz", "100", "--config", config)
    spin_until(executor, lambda: "instance_changed" in reasons(controller))
    assert controller.rule.instance_id != first
    rearmed = len(controller.steps)
    client = push.create_client(Trigger, "controller_rearm")
    spin_until(executor, client.service_is_ready)
    reply = client.call_async(Trigger.Request())
    spin_until(executor, reply.done)
    # The new guard keeps the hold of the killed one. Until its operator re-arms it, it trusts no
    # pose: its constraints have planes but no stamp, so they are never valid.
    spin_until(executor, lambda: "expired" in reasons(controller)[rearmed:])
    for reason, twist, _, message, _ in controller.steps[rearmed:]:
        assert not twist.any()
        if reason != "no_message":
            assert message.hold
            assert message.instance_id != first
        if reason == "expired":
            assert message.valid_until_ns == 0

    def is_rearmed():
        operator = start("-m", "app.cli", "rearm", "--yes")
        spin_until(executor, lambda: operator.process.poll() is not None)
        return operator.process.returncode == 0

    while not is_rearmed():  # it is refused while a pose is late: the operator tries again
        pass
    spin_until(executor, lambda: "allowed" in reasons(controller)[rearmed:])
    assert_within_planes(controller.steps)
    assert sender.process.poll() is None
