"""Hand for `twist_filter.py`: push straight at the tumour and print how much is allowed.

Publishes ``desired_twist`` along the normal of the governing plane, and ``tip``. The point of the
tool that is nearest to the tumour serves as the tip here; a robot's controller publishes the tip of
its own kinematics.

    python examples/controller/push.py
"""

import signal
import sys
import threading

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, TwistStamped
from marginguard_msgs.msg import FixtureConstraint
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

import marginguard as mg

PERIOD_S = 0.01
SPEED_M_S = 0.05
NEWEST = QoSProfile(depth=1)


class Push(Node):
    """Publishes a push while constraints with planes arrive, and reads what is allowed of it."""

    def __init__(self) -> None:
        super().__init__("push")
        self.plane = None
        self.frame = ""
        self.text = ""
        self.create_subscription(
            FixtureConstraint, "/marginguard/constraint", self.on_constraint, NEWEST
        )
        self.create_subscription(TwistStamped, "safe_twist", self.on_safe_twist, NEWEST)
        self.desired = self.create_publisher(TwistStamped, "desired_twist", NEWEST)
        self.tip = self.create_publisher(PointStamped, "tip", NEWEST)
        self.create_timer(PERIOD_S, self.push)
        self.create_timer(1.0, lambda: print(self.text, flush=True))

    def on_constraint(self, message: FixtureConstraint) -> None:
        """Keep the governing plane."""
        self.frame = message.header.frame_id
        self.plane = message.half_spaces[0] if message.half_spaces else None

    def push(self) -> None:
        """Publish the desired twist and the tip."""
        if self.plane is None:
            return
        twist, tip, n = TwistStamped(), PointStamped(), self.plane.normal
        twist.header.frame_id = tip.header.frame_id = self.frame
        v = twist.twist.linear
        v.x, v.y, v.z = -SPEED_M_S * n.x, -SPEED_M_S * n.y, -SPEED_M_S * n.z
        tip.point = self.plane.point_on_tool
        self.desired.publish(twist)
        self.tip.publish(tip)

    def on_safe_twist(self, message: TwistStamped) -> None:
        """Compare what is allowed with the push."""
        if self.plane is None:
            return
        v, n, p = message.twist.linear, self.plane.normal, self.plane.point_on_tool
        approach = 0.0 - np.dot([v.x, v.y, v.z], [n.x, n.y, n.z])
        clearance = np.dot([p.x, p.y, p.z], [n.x, n.y, n.z]) - self.plane.offset
        self.text = (
            f"{1e3 * clearance:.1f} mm to the stop margin, pushing {1e3 * SPEED_M_S:.0f} mm/s, "
            f"allowed {1e3 * approach:.1f} mm/s"
        )


def main() -> int:
    """Push until interrupted."""
    mg.prepare_ros()
    # rclpy's own handler of signals can shut down at the same time as the last line, and a
    # KeyboardInterrupt while a message is converted becomes another exception.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    executor = SingleThreadedExecutor()
    executor.add_node(Push())
    while not stopped.is_set():
        executor.spin_once()  # returns at each push
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
