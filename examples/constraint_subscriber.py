"""Print the constraint of a running session: plain rclpy, nothing of MarginGuard but its message.

Start a session in another terminal, then this one; Ctrl-C ends it. Expect one line per constraint,
with lengths in metres, as everywhere in ROS. A plain node communicates with the whole network,
unless ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST is set.

    marginguard replay package://marginguard/recorded_case --rate 1
    python examples/constraint_subscriber.py
"""

import rclpy
from marginguard_msgs.msg import FixtureConstraint

rclpy.init()
node = rclpy.create_node("constraint_subscriber")


def show(c: FixtureConstraint) -> None:
    """Print state, signed distance, hold and the number of planes."""
    print(c.seq, c.state, f"{c.signed_distance:.4f} m", c.hold, len(c.half_spaces), flush=True)


node.create_subscription(FixtureConstraint, "/marginguard/constraint", show, 1)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, Exception):
    if rclpy.ok():  # Ctrl-C ends the context, perhaps in the middle of a wait
        raise
