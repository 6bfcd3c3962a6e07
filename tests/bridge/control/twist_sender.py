"""Independent ROS process that sends desired twists and prints the allowed ones, with plain rclpy.

Prints ``ready`` when both topics are matched here. Then it sends each line of standard input,
{"frame", "late_s", "linear", "angular"}, and prints its reply as {"frame", "linear", "angular"};
``late_s`` is the age of the stamp. A command with ``again`` is repeated every second, for a limiter
that may not have found this process; the line ``null`` sends nothing and prints the next reply.
"""

import json
import sys
import time

import rclpy
from geometry_msgs.msg import TwistStamped
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("twist_sender")
    replies, matched = [], set()
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
        rclpy.spin_once(node)
    print("ready", flush=True)

    def send(request):
        command = TwistStamped()
        command.header.frame_id = request["frame"]
        late = Duration(nanoseconds=round(request["late_s"] * 1e9))
        command.header.stamp = (node.get_clock().now() - late).to_msg()
        linear, angular = command.twist.linear, command.twist.angular
        linear.x, linear.y, linear.z = request["linear"]
        angular.x, angular.y, angular.z = request["angular"]
        publisher.publish(command)
        return command.header.stamp

    def reply_to(request):
        stamp, end_s = request and send(request), time.monotonic() + 1.0
        while True:
            rclpy.spin_once(node, timeout_sec=0.1)
            while replies:
                reply = replies.pop(0)
                # Skip replies of the timeout, which belong to no command.
                if stamp is None or reply.header.stamp == stamp:
                    return reply
            if request and request.get("again") and time.monotonic() > end_s:
                stamp, end_s = send(request), time.monotonic() + 1.0

    for line in sys.stdin:
        reply = reply_to(json.loads(line))
        linear, angular = reply.twist.linear, reply.twist.angular
        result = {
            "frame": reply.header.frame_id,
            "linear": [linear.x, linear.y, linear.z],
            "angular": [angular.x, angular.y, angular.z],
        }
        print(json.dumps(result), flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
