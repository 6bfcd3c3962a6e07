"""Independent ROS process that sends desired twists and prints the allowed ones, with plain rclpy.

    twist_sender.py [held] JSON ...

Each JSON is {"frame", "late_s", "linear", "angular"}; ``late_s`` is the age of its stamp. Prints
``ready`` when both topics are matched here. With ``held`` it then waits for SIGUSR1, so that the
other process can find it as well. Then prints each reply as {"frame", "linear", "angular"}. At the
end it sends nothing and prints the reply of the timeout.
"""

import json
import signal
import sys
import threading

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks


def main() -> int:
    found = threading.Event()
    signal.signal(signal.SIGUSR1, lambda *_: found.set())
    rclpy.init()
    node = rclpy.create_node("twist_sender")
    replies = []
    matched = set()
    publisher = node.create_publisher(
        TwistStamped,
        "/marginguard/desired_twist",
        1,
        event_callbacks=PublisherEventCallbacks(matched=lambda _: matched.add("out")),
    )
    node.create_subscription(
        TwistStamped,
        "/marginguard/allowed_twist",
        replies.append,
        100,
        event_callbacks=SubscriptionEventCallbacks(matched=lambda _: matched.add("in")),
    )
    while len(matched) < 2:
        rclpy.spin_once(node, timeout_sec=30.0)
    print("ready", flush=True)
    arguments = sys.argv[1:]
    if arguments[0] == "held":
        arguments = arguments[1:]
        found.wait()
    for argument in [*arguments, "null"]:
        request = json.loads(argument)
        stamp = None
        if request is not None:
            command = TwistStamped()
            command.header.frame_id = request["frame"]
            late = Duration(nanoseconds=round(request["late_s"] * 1e9))
            stamp = command.header.stamp = (node.get_clock().now() - late).to_msg()
            linear, angular = command.twist.linear, command.twist.angular
            linear.x, linear.y, linear.z = request["linear"]
            angular.x, angular.y, angular.z = request["angular"]
            publisher.publish(command)
        replies.clear()
        # Skip replies of the timeout, which belong to no command.
        while not replies or (stamp is not None and replies[-1].header.stamp != stamp):
            rclpy.spin_once(node, timeout_sec=30.0)
        reply = replies[-1]
        linear, angular = reply.twist.linear, reply.twist.angular
        result = {
            "frame": reply.header.frame_id,
            "linear": [linear.x, linear.y, linear.z],
            "angular": [angular.x, angular.y, angular.z],
        }
        if request is None:  # leave the graph before the test kills this process
            node.destroy_node()
            rclpy.shutdown()
        print(json.dumps(result), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
