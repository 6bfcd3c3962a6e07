"""ROS process with another version of ``marginguard_msgs``: publishes or subscribes.

    other_peer.py SITE publish|subscribe TOPIC TYPE

``SITE`` is the folder with the other version. Prints ``matched`` at each change of the connected
endpoints, and ends when its standard input is closed. It does not import the project.
"""

import sys
import threading

sys.path.insert(0, sys.argv[1])

import marginguard_msgs.msg
import rclpy
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks


def main() -> None:
    """Publish 50 messages per second, or subscribe, until the standard input ends."""
    role, topic, name = sys.argv[2:]
    kind = getattr(marginguard_msgs.msg, name)
    rclpy.init()
    node = rclpy.create_node("other_version")

    def matched(_: object) -> None:
        print("matched", flush=True)

    if role == "publish":
        publisher = node.create_publisher(
            kind, topic, 10, event_callbacks=PublisherEventCallbacks(matched=matched)
        )
        message = kind(extra=1.5)
        message.header.frame_id = "tracker"
        node.create_timer(0.02, lambda: publisher.publish(message))
    else:
        node.create_subscription(
            kind,
            topic,
            lambda message: None,
            10,
            event_callbacks=SubscriptionEventCallbacks(matched=matched),
        )
    ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    while not ended.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)


if __name__ == "__main__":
    main()
