"""Process of `benchmarks.soak` that receives constraints of the guard and of the bare sender.

    receiver.py

Prints ``figures`` for each topic when standard input has a line, and ends with its end. Uses rclpy
alone.
"""

import json
import sys
import threading
import time
from contextlib import suppress

import numpy as np
import rclpy
from marginguard_msgs.msg import FixtureConstraint
from numpy.typing import NDArray
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile

from benchmarks.rate_receiver import seq_of

TOPICS = ("/marginguard/constraint", "/bare/constraint")
LATE_NS = 10_000_000
BIN_NS = 10_000
BINS = 100_000
"""Bins of the histogram of gaps, up to 1 s; the last bin has all longer ones."""


class Stream:
    """Counts and gaps of one topic; gaps before `restart` do not count."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all gaps and counts."""
        self.received = self.lost = self.over_10_ms = 0
        self.max_gap_ns = 0
        self.histogram = np.zeros(BINS, dtype=np.int64)
        self.last_ns = self.last_seq = None

    def take(self, raw: bytes) -> None:
        """Count one message."""
        now_ns, seq = time.monotonic_ns(), seq_of(raw)
        if self.last_ns is not None:
            gap_ns = now_ns - self.last_ns
            self.max_gap_ns = max(self.max_gap_ns, gap_ns)
            self.over_10_ms += gap_ns > LATE_NS
            self.histogram[min(gap_ns // BIN_NS, BINS - 1)] += 1
            self.lost += max(0, seq - self.last_seq - 1)
        self.received += 1
        self.last_ns, self.last_seq = now_ns, seq

    def figures(self) -> dict[str, float]:
        """The counts, the 99.99th percentile of the gaps and the longest one, in ms."""
        return {
            "received": self.received,
            "lost": self.lost,
            "over_10_ms": self.over_10_ms,
            "p9999_gap_ms": percentile_ms(self.histogram, 0.9999),
            "max_gap_ms": self.max_gap_ns / 1e6,
        }


def percentile_ms(histogram: NDArray[np.int64], share: float) -> float:
    """Upper edge in ms of the bin below which ``share`` of the gaps are; 0 without gaps."""
    cumulated = np.cumsum(histogram)
    if not cumulated[-1]:
        return 0.0
    return float(np.searchsorted(cumulated, share * cumulated[-1]) + 1) * BIN_NS / 1e6


def main() -> int:
    rclpy.init()
    node = rclpy.create_node("soak_receiver")
    streams = {topic: Stream() for topic in TOPICS}
    for topic, stream in streams.items():
        qos = QoSProfile(depth=1000)
        node.create_subscription(FixtureConstraint, topic, stream.take, qos, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def answer() -> None:
        for line in sys.stdin:
            if line.strip() == '{"do": "restart"}':
                for stream in streams.values():
                    stream.restart()
            figures = {topic: stream.figures() for topic, stream in streams.items()}
            print(json.dumps({"event": "figures", "topics": figures}), flush=True)
        rclpy.shutdown()

    threading.Thread(target=answer, daemon=True).start()
    print('{"event": "ready"}', flush=True)
    with suppress(ExternalShutdownException):
        executor.spin()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
