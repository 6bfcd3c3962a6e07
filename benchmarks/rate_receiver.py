"""Process of `benchmarks.rate` that records arrival and seq of each constraint.

Uses rclpy alone and reads the bytes by the CDR layout, independently of the sender's code.
"""

import array
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from marginguard_msgs.msg import FixtureConstraint
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile


def seq_of(raw: bytes) -> int:
    """``seq`` of a serialised FixtureConstraint.

    Layout: 4 bytes of encapsulation, two 4-byte integers, a string, then ``seq`` aligned to 8.
    """
    (length,) = struct.unpack_from("<I", raw, 12)
    offset = 4 + -(-(12 + length) // 8) * 8
    seq: int = struct.unpack_from("<Q", raw, offset)[0]
    return seq


def main() -> int:
    folder = Path(sys.argv[1])
    records = array.array("q")

    def take(raw: bytes) -> None:
        now_ns = time.monotonic_ns()
        records.extend((seq_of(raw), now_ns))

    rclpy.init()
    node = rclpy.create_node("rate_receiver")
    node.create_subscription(
        FixtureConstraint,
        "/rate_sender/constraint",
        take,
        QoSProfile(depth=1000),
        raw=True,
        event_callbacks=SubscriptionEventCallbacks(matched=lambda _: print("ready", flush=True)),
    )
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(node)
    ended = rclpy.task.Future()

    def wait_for_end() -> None:
        sys.stdin.readline()
        sys.stdin.readline()
        time.sleep(0.2)  # messages in transit
        executor.create_task(lambda: ended.set_result(True))

    threading.Thread(target=wait_for_end, daemon=True).start()
    try:
        executor.spin_until_future_complete(ended)
    except ExternalShutdownException:
        return 1
    np.save(folder / "received.npy", np.array(records, dtype=np.int64).reshape(-1, 2))
    rclpy.shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
