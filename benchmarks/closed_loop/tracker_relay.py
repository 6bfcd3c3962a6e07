"""Process of the tracker's driver: passes the samples of the simulated tracker on, unchanged."""

import sys
import threading

from marginguard_msgs.msg import TrackedTransform

from app.bridge import RosNode, prepare_environment
from app.bridge.qos import STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS
from benchmarks.closed_loop.physics import RAW_TOPIC


def main() -> int:
    """Relay until standard input ends."""
    prepare_environment()
    stop = threading.Event()
    with RosNode("tracker_driver") as ros:
        publisher = ros.publisher(TRACKED_TRANSFORMS)
        ros.subscribe(Topic(RAW_TOPIC, TrackedTransform, STREAM), publisher.publish, raw=True)
        print('{"event": "ready"}', flush=True)
        threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
        stop.wait()
    return 0


if __name__ == "__main__":
    sys.exit(main())
