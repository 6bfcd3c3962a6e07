"""Pace of a simulated world against the clock of the host, in a process of its own.

'marginguard simulate' runs in real time; this process receives the poses that it publishes every
5 ms, each with the host time that its simulated time stands for.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.geometry import NS_PER_MS, NS_PER_S, MarginGuardError
from benchmarks.harness.figures import Spread
from benchmarks.harness.processes import CLI, Child, ChildError, children
from benchmarks.ros_domain import own_ros

Times = NDArray[np.int64]

ENDS = 2000
"""Messages at each end whose median delays are compared: 10 s."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Delay of the poses behind their stamps, in ms, and what of the time was not simulated.

    ``drift_ms``: by how much the median delay of the last `ENDS` messages is larger than that of
    the first ones. ``missing_s``: time between the stamps that no message stands for: lags that the
    physics has dropped, and lost messages.
    """

    seconds: float
    median_ms: float
    p99_ms: float
    max_ms: float
    drift_ms: float
    missing_s: float

    @classmethod
    def of(cls, stamps_ns: Times, arrivals_ns: Times, period_ns: int) -> "Pace":
        """The pace of messages with ``stamps_ns`` (n,) that arrived at ``arrivals_ns`` (n,).

        Raises `MarginGuardError` for fewer than two messages.
        """
        if len(stamps_ns) < 2:
            raise MarginGuardError(f"simulation: {len(stamps_ns)} poses; expected at least 2")
        delays_ms = (arrivals_ns - stamps_ns) / NS_PER_MS
        ends = min(ENDS, len(delays_ms) // 2)
        spread = Spread.of(delays_ms)
        span_ns = int(stamps_ns[-1] - stamps_ns[0])
        return cls(
            seconds=span_ns / NS_PER_S,
            median_ms=spread.p50_ms,
            p99_ms=spread.p99_ms,
            max_ms=spread.max_ms,
            drift_ms=float(np.median(delays_ms[-ends:]) - np.median(delays_ms[:ends])),
            missing_s=(span_ns - (len(stamps_ns) - 1) * period_ns) / NS_PER_S,
        )


def measured_pace(world: Path, minutes: float) -> Pace:
    """Run ``world`` for that long, and measure its pace. Raises `MarginGuardError`."""
    try:
        with own_ros() as folder, children(folder) as (_, start):
            simulation = start("simulation", *CLI, "simulate", world)
            simulation.line("SIMULATION", 300.0)
            return _received(simulation, minutes)
    except ChildError as error:
        raise MarginGuardError(f"{error}; expected it to run") from error


def _received(simulation: Child, minutes: float) -> Pace:
    from app.bridge import RosNode, topics
    from app.bridge.simulation.simulation_node import STATE_PERIOD_NS
    from app.bridge.tf.wire import TfMessageReader
    from app.bridge.world_editor import TRUTH

    read = TfMessageReader()
    stamps: list[int] = []
    arrivals: list[int] = []

    def take(data: bytes) -> None:
        now_ns = time.time_ns()
        samples = read(data)
        if samples and samples[0].child.startswith(TRUTH):
            stamps.append(samples[0].stamp_ns)
            arrivals.append(now_ns)

    with RosNode("pace") as ros:
        ros.subscribe(topics.TF, take, raw=True)
        end_s = time.monotonic() + 60.0 * minutes
        while (left_s := end_s - time.monotonic()) > 0.0:
            simulation.poll(min(left_s, 1.0))
    return Pace.of(np.array(stamps), np.array(arrivals), STATE_PERIOD_NS)
