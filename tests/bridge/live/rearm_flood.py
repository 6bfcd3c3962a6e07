"""Independent ROS process that sends invalid re-arm requests at a rate until its input ends.

    rearm_flood.py REQUESTS_PER_S

Prints ``ready`` after the first reply. It does not import the project.
"""

import sys
import threading

import rclpy
from marginguard_msgs.srv import Rearm


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("rearm_flood")
    client = node.create_client(Rearm, "/marginguard/rearm")
    if not client.wait_for_service(timeout_sec=30.0):
        print("no service /marginguard/rearm", file=sys.stderr)
        return 1
    first = client.call_async(Rearm.Request(seq=0, nonce=1))
    rclpy.spin_until_future_complete(node, first, timeout_sec=30.0)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    node.create_timer(
        1.0 / float(sys.argv[1]), lambda: client.call_async(Rearm.Request(seq=0, nonce=1))
    )
    print("ready", flush=True)
    while not ended.is_set():
        rclpy.spin_once(node, timeout_sec=0.1)
    return 0


if __name__ == "__main__":
    sys.exit(main())
