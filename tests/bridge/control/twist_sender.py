"""An independent ROS process: sends desired twists and prints what is allowed, by rclpy alone.

    twist_sender.py JSON ...

Each JSON is {"frame", "late_s", "linear", "angular"}; ``late_s`` is how old its stamp is. Prints
``ready`` when both topics are matched, then for each the answer as {"frame", "linear", "angular"}.
Last it sends nothing, and prints the answer that comes all the same.
"""

import json
import sys

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("twist_sender")
    answers = []
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
        answers.append,
        100,
        event_callbacks=SubscriptionEventCallbacks(matched=lambda _: matched.add("in")),
    )
    while len(matched) < 2:
        rclpy.spin_once(node, timeout_sec=30.0)
    print("ready", flush=True)
    for argument in [*sys.argv[1:], "null"]:
        asked = json.loads(argument)
        stamp = None
        if asked is not None:
            command = TwistStamped()
            command.header.frame_id = asked["frame"]
            late = Duration(nanoseconds=round(asked["late_s"] * 1e9))
            stamp = command.header.stamp = (node.get_clock().now() - late).to_msg()
            linear, angular = command.twist.linear, command.twist.angular
            linear.x, linear.y, linear.z = asked["linear"]
            angular.x, angular.y, angular.z = asked["angular"]
            publisher.publish(command)
        answers.clear()
        # What the time-out says between two commands is not the answer to one.
        while not answers or (stamp is not None and answers[-1].header.stamp != stamp):
            rclpy.spin_once(node, timeout_sec=30.0)
        answer = answers[-1]
        linear, angular = answer.twist.linear, answer.twist.angular
        said = {
            "frame": answer.header.frame_id,
            "linear": [linear.x, linear.y, linear.z],
            "angular": [angular.x, angular.y, angular.z],
        }
        if asked is None:  # nobody is to wait for what a process that was killed has not got
            node.destroy_node()
            rclpy.shutdown()
        print(json.dumps(said), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
