"""ROS 2 controller: pass on the part of a desired twist that the virtual fixture allows now.

Subscribes ``/marginguard/constraint``, ``desired_twist`` and ``tip`` (``PointStamped``), publishes
``safe_twist`` at 200 Hz, and serves ``controller_rearm`` for the controller's own operator. All
vectors are along the axes of the constraint's frame, in m and m/s.

    python examples/controller/twist_filter.py --frame tumor

Poses that are recorded or simulated allow no motion, unless ``--accept-simulated`` is given, and no
constraint does while a guard has other message definitions.
"""

import argparse
import signal
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, TwistStamped
from marginguard_msgs.msg import FixtureConstraint
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from std_msgs.msg import Header
from std_srvs.srv import Trigger

import marginguard as mg

MM_PER_M = 1000.0

TOPIC = "/marginguard/constraint"
PERIOD_S, COMPARE_S = 0.005, 1.0
MAX_COMMAND_AGE_NS = 100_000_000
NEWEST = QoSProfile(depth=1)


class TwistFilter(Node):
    """Node around `mg.FixtureRule`; its clock is that of the tracker's stamps (``clock: host``)."""

    def __init__(self, frame: str, *, accept_simulated: bool = False) -> None:
        super().__init__("twist_filter")
        self.rule = mg.FixtureRule(frame=frame, accept_simulated=accept_simulated)
        self.frame = frame
        self.desired: tuple[int, np.ndarray] | None = None
        self.tip: tuple[int, np.ndarray] | None = None
        self.logged = ""
        self.others: dict[str, str] = {}
        self.compared = ""
        self.create_subscription(FixtureConstraint, TOPIC, self.receive, NEWEST)
        self.create_subscription(TwistStamped, "desired_twist", self.command, NEWEST)
        self.create_subscription(PointStamped, "tip", self.move, NEWEST)
        self.create_service(Trigger, "controller_rearm", self.rearm)
        self.safe = self.create_publisher(TwistStamped, "safe_twist", NEWEST)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(PERIOD_S, self.step, clock=steady)
        self.create_timer(COMPARE_S, self.compare, clock=steady)

    def now_ns(self) -> int:
        """System time; the stamps of the constraint have to be on this clock.

        The node's own clock is not used: with ``use_sim_time`` a paused ``/clock`` would stop it,
        and silence would have no age.
        """
        return time.time_ns()

    def receive(self, message: FixtureConstraint) -> None:
        """Pass a constraint to the rule, unless a guard has other message definitions."""
        if message.instance_id != self.compared:
            self.compare()
            self.compared = message.instance_id
        if not self.others:
            self.rule.receive(mg.plain_constraint(message), self.now_ns())

    def compare(self) -> None:
        """Look for guards whose messages this node would decode wrongly."""
        others = mg.other_definitions(self, TOPIC)
        if others != self.others:
            self.others = others
            names = ", ".join(others) or "none"
            self.get_logger().warning(f"guards with other message definitions: {names}")

    def command(self, message: TwistStamped) -> None:
        """Keep the desired twist, in mm/s and rad/s."""
        v, w = message.twist.linear, message.twist.angular
        values = np.array([MM_PER_M * v.x, MM_PER_M * v.y, MM_PER_M * v.z, w.x, w.y, w.z])
        self.desired = (self.now_ns(), values) if message.header.frame_id == self.frame else None

    def move(self, message: PointStamped) -> None:
        """Keep the position of the tool's tip, in mm."""
        p = message.point
        values = MM_PER_M * np.array([p.x, p.y, p.z])
        self.tip = (self.now_ns(), values) if message.header.frame_id == self.frame else None

    def rearm(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Accept the guard that sends now, at the request of the controller's operator."""
        self.rule.rearm()
        response.success = True
        return response

    def step(self) -> None:
        """One control step. A command or a tip that is missing or old is no motion."""
        now_ns, twist, reason = self.now_ns(), np.zeros(6), "no_command"
        inputs = (self.desired, self.tip)
        # A time ahead of the clock has an unknown age: the clock was set back.
        if all(each and 0 <= now_ns - each[0] <= MAX_COMMAND_AGE_NS for each in inputs):
            decision = self.rule.allow(self.desired[1], self.tip[1], now_ns)
            twist, reason = decision.twist, str(decision.reason)
        else:
            self.rule.stand(now_ns)
        if reason != self.logged:
            self.logged = reason
            self.get_logger().info(f"{reason}, guard {self.rule.instance_id}")
        message = TwistStamped()
        message.header.frame_id = self.frame
        message.header.stamp = Time(nanoseconds=now_ns).to_msg()
        v, w = message.twist.linear, message.twist.angular
        v.x, v.y, v.z, w.x, w.y, w.z = map(float, twist / ([MM_PER_M] * 3 + [1.0] * 3))
        self.safe.publish(message)


def main() -> int:
    """Run the node until it is interrupted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frame", default="tumor", help="frame of the constraint")
    parser.add_argument(
        "--accept-simulated",
        action="store_true",
        help="allow motion by recorded or simulated poses; never where a robot can hurt somebody",
    )
    print(mg.prepare_ros())  # the nodes on this machine, unless the variables of ROS say else
    # The handlers of rclpy end its context at once; these let the last message be published.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    args = parser.parse_args(rclpy.utilities.remove_ros_args(sys.argv)[1:])
    node = TwistFilter(args.frame, accept_simulated=args.accept_simulated)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stopped.is_set():
        executor.spin_once()  # returns at each control step
    node.safe.publish(TwistStamped(header=Header(frame_id=node.frame)))
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
