"""Processes of `benchmarks.soak`: ``python -m benchmarks.soak.processes PART [ARGUMENT]``.

``receiver`` counts constraints of guard and bare sender with rclpy alone, and prints ``figures``
for each line of input. ``sender SECONDS`` sends a constraint's bytes at 1 kHz with rclpy alone, in
the scheduling class of the guard's thread, and shows what gaps the machine itself causes. ``browser
URL`` plays the page of a replay again and again in headless Chromium.
"""

import sys
import threading
import time
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.peer import emit, input_ended, paced, seq_of

GUARD, BARE = "/marginguard/constraint", "/bare/constraint"
LATE_NS = 10_000_000
BIN_NS = 10_000
BINS = 100_000  # bins of the histogram of gaps, up to 1 s; the last bin has all longer ones
CHECK_MS = 1000.0  # interval between checks whether the recording has ended


class Stream:
    """Counts and gaps of one topic; gaps before `restart` do not count."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        self.received = self.lost = self.over_10_ms = 0
        self.max_gap_ns = 0
        self.histogram = np.zeros(BINS, dtype=np.int64)
        self.last_ns = self.last_seq = None

    def take(self, raw: bytes) -> None:
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


def receiver() -> None:
    import rclpy
    from marginguard_msgs.msg import FixtureConstraint
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

    rclpy.init()
    node = rclpy.create_node("soak_receiver")
    streams = {topic: Stream() for topic in (GUARD, BARE)}
    for topic, stream in streams.items():
        node.create_subscription(FixtureConstraint, topic, stream.take, 1000, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def answer() -> None:
        for line in sys.stdin:
            if "restart" in line:
                for stream in streams.values():
                    stream.restart()
            emit("figures", topics={topic: each.figures() for topic, each in streams.items()})
        rclpy.shutdown()

    threading.Thread(target=answer, daemon=True).start()
    emit("ready")
    with suppress(ExternalShutdownException):
        executor.spin()


def sender(seconds: str) -> None:
    import rclpy
    from marginguard_msgs.msg import FixtureConstraint, HalfSpace
    from rclpy.serialization import serialize_message

    from app.bridge.heartbeat import ask_for_real_time

    rclpy.init()
    node = rclpy.create_node("bare")
    publisher = node.create_publisher(FixtureConstraint, BARE, 1)
    message = FixtureConstraint(instance_id="0" * 32, half_spaces=[HalfSpace()])

    def send(beat: int) -> None:
        message.seq = beat
        publisher.publish(serialize_message(message))

    ask_for_real_time()
    paced(round(1000.0 * float(seconds)), 1e6, send)
    rclpy.shutdown()


def browser(url: str) -> None:
    from playwright.sync_api import sync_playwright

    from benchmarks.view.chromium import SIZE, launch

    ended = input_ended()
    with sync_playwright() as playwright:
        page = launch(playwright).new_page(viewport=SIZE)
        page.goto(url)
        page.wait_for_selector("body:not([data-lost]) #state-label")
        emit("ready")
        while not ended.is_set():
            if page.locator(".paused").count():
                page.keyboard.press("Space")
            page.wait_for_timeout(CHECK_MS)


if __name__ == "__main__":
    {"receiver": receiver, "sender": sender, "browser": browser}[sys.argv[1]](*sys.argv[2:])
