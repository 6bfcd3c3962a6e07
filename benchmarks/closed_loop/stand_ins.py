"""Processes beside the guard: ``python -m benchmarks.closed_loop.stand_ins guard|tracker``.

``guard`` takes the place of the guard and never limits: its plane is 10 m away. A test double, for
pushes without the fixture; the controller and all else are the same. ``tracker`` is the tracker's
driver: it passes the samples of the simulated tracker on, unchanged.
"""

import math
import sys
import time

from marginguard_msgs.msg import FixtureConstraint, HalfSpace, TrackedTransform

from app.bridge import RosNode, prepare_environment
from app.bridge.topics import NEWEST, STREAM, Topic
from app.bridge.tracker_publisher import TRACKED_TRANSFORMS
from app.fixture import MAX_TURN_RAD_S
from app.geometry import NS_PER_MS
from benchmarks.harness.peer import emit, input_ended, set_time

RAW_TOPIC = "/tracker/raw"  # where the physics publishes the tracker's samples
FAR_M = 10.0
PERIOD_S = 0.005
VALID_NS = 100 * NS_PER_MS


def guard() -> None:
    stop = input_ended()
    with RosNode("marginguard") as ros:
        publisher = ros.publisher(Topic("/marginguard/constraint", FixtureConstraint, NEWEST))
        emit("ready")
        half_space = HalfSpace(offset=-FAR_M)
        half_space.normal.z = 1.0
        message = FixtureConstraint(
            instance_id="open",
            setup_id="open",
            simulated=True,
            planes_current=True,
            free_distance=FAR_M,
            free_turn=math.pi,
            max_tool_speed=FAR_M,
            max_tool_turn=MAX_TURN_RAD_S,
        )
        message.header.frame_id = "tumor"
        # As in the world's live.yaml, where the sensor's frame is that of the tumour.
        message.tumor.header.frame_id, message.tumor.child_frame_id = "tumor_sensor", "tumor"
        message.half_spaces = [half_space]
        while not stop.wait(PERIOD_S):
            now_ns = time.time_ns()
            message.seq += 1
            set_time(message.header.stamp, now_ns)
            set_time(message.valid_until, now_ns + VALID_NS)
            publisher.publish(message)


def tracker() -> None:
    stop = input_ended()
    with RosNode("tracker_driver") as ros:
        publisher = ros.publisher(TRACKED_TRANSFORMS)
        ros.subscribe(Topic(RAW_TOPIC, TrackedTransform, STREAM), publisher.publish, raw=True)
        emit("ready")
        stop.wait()


if __name__ == "__main__":
    prepare_environment()
    {"guard": guard, "tracker": tracker}[sys.argv[1]]()
