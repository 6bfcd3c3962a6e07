"""Print the constraint of a running session: plain rclpy, nothing of MarginGuard but its message.

Start a session in another terminal, then this one; Ctrl-C ends it. Expect one line per constraint,
with lengths in metres, as everywhere in ROS. A plain node communicates with the whole network,
unless ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST is set.

    marginguard replay package://marginguard/recorded_case --rate 1
    python examples/constraint_subscriber.py
"""

import signal
import threading

import rclpy
from marginguard_msgs.msg import FixtureConstraint
from rclpy.signals import SignalHandlerOptions

# rclpy's own handler of signals may shut down in the middle of a wait or of a line.
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("constraint_subscriber")
stopped = threading.Event()
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: stopped.set())


def show(c: FixtureConstraint) -> None:
    """Print state, signed distance, hold and the number of planes."""
    print(c.seq, c.state, f"{c.signed_distance:.4f} m", c.hold, len(c.half_spaces), flush=True)


node.create_subscription(FixtureConstraint, "/marginguard/constraint", show, 1)
while not stopped.is_set():
    rclpy.spin_once(node, timeout_sec=0.1)
rclpy.shutdown()
