"""Independent ROS process that prints the messages it receives; plain rclpy, not the project.

    receiver.py TOPIC:TYPE:COUNT[:latched] ...

Prints ``ready`` when every topic has a publisher (a volatile reader drops messages that are sent
before it has discovered the writer), then ``{"topic": ..., "message": {...}}`` per line. Exits with
status 0 when every topic has received its COUNT of messages, with 1 after a minute without any.
"""

import json
import sys
import time

import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tests.bridge.peers import as_plain, interface


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("receiver")
    waiting = {}
    unmatched = set()
    done = rclpy.task.Future()

    received_s = [time.monotonic()]

    def on_message(topic, message):
        received_s[0] = time.monotonic()
        print(json.dumps({"topic": topic, "message": as_plain(message)}), flush=True)
        waiting[topic] -= 1
        if max(waiting.values()) <= 0 and not done.done():
            done.set_result(True)

    def on_matched(topic):
        if topic in unmatched:
            unmatched.remove(topic)
            if not unmatched:
                print("ready", flush=True)

    for argument in sys.argv[1:]:
        topic, kind, count, *latched = argument.split(":")
        waiting[topic] = int(count)
        unmatched.add(topic)
        qos = QoSProfile(
            depth=1000,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        node.create_subscription(
            interface(kind),
            topic,
            lambda message, topic=topic: on_message(topic, message),
            qos,
            event_callbacks=SubscriptionEventCallbacks(
                matched=lambda _, topic=topic: on_matched(topic)
            ),
        )
    while not done.done() and time.monotonic() - received_s[0] < 60.0:
        rclpy.spin_until_future_complete(node, done, timeout_sec=1.0)
    node.destroy_node()
    rclpy.shutdown()
    if not done.done():
        print(f"still waiting for {waiting}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
