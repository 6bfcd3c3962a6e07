"""Process of `benchmarks.soak` that sends a constraint's bytes at 1 kHz with rclpy alone.

    sender.py SECONDS

It shows what gaps the machine itself causes. Uses the scheduling class of the guard's thread.
"""

import sys
import time

import rclpy
from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from app.bridge.heartbeat import ask_for_real_time

PERIOD_NS = 1_000_000
TOPIC = "/bare/constraint"


def main() -> int:
    seconds = float(sys.argv[1])
    rclpy.init()
    node = rclpy.create_node("bare")
    publisher = node.create_publisher(FixtureConstraint, TOPIC, QoSProfile(depth=1))
    message = FixtureConstraint(instance_id="0" * 32, half_spaces=[HalfSpace()])
    ask_for_real_time()
    print('{"event": "ready"}', flush=True)
    begin_ns = time.monotonic_ns()
    for beat in range(round(seconds * 1e9 / PERIOD_NS)):
        ahead_ns = begin_ns + beat * PERIOD_NS - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns / 1e9)
        message.seq = beat
        publisher.publish(serialize_message(message))
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
