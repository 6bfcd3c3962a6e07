"""Process in the place of the guard that never limits: its plane is 10 m away.

A test double, for pushes without the fixture. The controller and all else are the same.
"""

import sys
import threading
import time

from marginguard_msgs.msg import FixtureConstraint, HalfSpace

from app.bridge import RosNode, prepare_environment
from app.bridge.qos import NEWEST, Topic
from app.geometry import NS_PER_MS, NS_PER_S

FAR_M = 10.0
PERIOD_S = 0.005
VALID_NS = 100 * NS_PER_MS


def main() -> int:
    """Publish until standard input ends."""
    prepare_environment()
    stop = threading.Event()
    with RosNode("marginguard") as ros:
        publisher = ros.publisher(Topic("/marginguard/constraint", FixtureConstraint, NEWEST))
        threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
        print('{"event": "ready"}', flush=True)
        half_space = HalfSpace(offset=-FAR_M)
        half_space.normal.z = 1.0
        message = FixtureConstraint(instance_id="open", simulated=True, planes_current=True)
        message.header.frame_id = "tumor"
        message.half_spaces = [half_space]
        while not stop.wait(PERIOD_S):
            now_ns = time.time_ns()
            message.seq += 1
            stamp, until = message.header.stamp, message.valid_until
            stamp.sec, stamp.nanosec = divmod(now_ns, NS_PER_S)
            until.sec, until.nanosec = divmod(now_ns + VALID_NS, NS_PER_S)
            publisher.publish(message)
    return 0


if __name__ == "__main__":
    sys.exit(main())
