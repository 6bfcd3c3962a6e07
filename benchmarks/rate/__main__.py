"""Publish the constraint to another process at 1 kHz for a minute, beside a session at 50 Hz.

Three processes run at a time. The sender steps a session with the recorded case's frames in real
time and sends the constraint 1000 times a second. The receiver takes it as bytes. The bare loop
only sleeps from millisecond to millisecond, in the scheduling class of the sending thread
(real-time where allowed), and shows the latency of the machine itself. The receiver is an ordinary
process. All times are of CLOCK_MONOTONIC, which the processes of a machine share.

Messages of the steps are sent in addition to the beats and do not count in their rate. A late beat
is sent late; one that is 10 ms late is skipped.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from app.cli.progress import announce_duration
from benchmarks.harness.figures import figures_table, percentiles, show
from benchmarks.harness.goals import Goal, at_least, at_most, finish
from benchmarks.harness.options import BenchParser
from benchmarks.harness.processes import children
from benchmarks.rate.processes import Times
from benchmarks.ros_domain import own_ros

MIN_MEAN_HZ = 999.0
MAX_GAP_MS = 10.0
MAX_P99_MS = 2.0


def gaps(times_ns: Times) -> dict[str, Any]:
    """Gaps of sorted times (n,) in ns: 99th percentile, longest, and number above 10 ms."""
    gaps_ms = np.diff(times_ns) / 1e6
    p99, longest = percentiles(gaps_ms, 99, 100)
    return {"p99_ms": p99, "max_ms": longest, "over_10_ms": int((gaps_ms > MAX_GAP_MS).sum())}


def figures(
    sent_ns: Times, received: Times, bare_ns: Times, *, missed: int, steps: int, cpu_s: float
) -> dict[str, Any]:
    """Figures of sending times (n,) by seq, rows (m, 2) of seq and arrival, and the bare loop's.

    Delays are from just before sending to the receiver's callback.
    """
    seqs, arrived_ns = received.T
    known = (seqs >= 0) & (seqs < len(sent_ns))
    delays_ms = (arrived_ns[known] - sent_ns[seqs[known]]) / 1e6
    p50, p99, longest = percentiles(delays_ms, 50, 99, 100)
    seconds = float(sent_ns[-1] - sent_ns[0]) / 1e9
    return {
        "seconds": seconds, "sent": len(sent_ns), "received": len(received),
        "in_order": bool(np.array_equal(seqs, np.arange(len(sent_ns)))),
        "mean_hz": (len(sent_ns) - 1) / seconds, "beats_hz": (len(sent_ns) - 1 - steps) / seconds,
        "missed_beats": missed, "steps": steps, "sender_cpu_share": cpu_s / seconds,
        "sent_gaps": gaps(sent_ns), "received_gaps": gaps(arrived_ns), "bare_gaps": gaps(bare_ns),
        "delay_p50_ms": p50, "delay_p99_ms": p99, "delay_max_ms": longest,
    }  # fmt: skip


def goals(found: Mapping[str, Any]) -> Iterator[Goal]:
    gap_ms = max(MAX_GAP_MS, found["bare_gaps"]["max_ms"])
    order = f"{found['received']} of {found['sent']} messages, in order: {found['in_order']}"
    yield at_least("the beats' rate is", found["beats_hz"], MIN_MEAN_HZ, "Hz", ".2f")
    yield at_most("a gap of", found["sent_gaps"]["max_ms"], gap_ms, "ms", ".2f")
    yield Goal("received are", order, found["in_order"], "all in order")
    yield at_most("p99 of the delay is", found["delay_p99_ms"], MAX_P99_MS, "ms", ".3f")


def run(seconds: float, case: Path) -> dict[str, Any]:
    with own_ros() as folder, children(folder) as (parts, start):
        for part in ("receiver", "sender", "bare"):
            start(part, "-m", "benchmarks.rate.processes", part, folder, seconds, case)
        for part in parts.values():
            part.expect("ready", 300.0)  # loaded; sender and receiver have discovered each other
        for part in parts.values():
            part.send(do="go")
        report, _ = (parts[name].expect("done", seconds + 60.0) for name in ("sender", "bare"))
        parts["receiver"].send(do="end")
        parts["receiver"].expect("done")
        sent, received, bare = (
            np.load(folder / f"{name}.npy") for name in ("sent", "received", "bare")
        )
        known = {name: report[name] for name in ("missed", "steps", "cpu_s")}
        return figures(sent, received, bare, **known)


def main() -> int:
    parser = BenchParser("rate", __doc__)
    parser.number("--seconds", 60.0, "how long")
    parser.case()
    options = parser.parse_args()
    announce_duration("publishing", options.seconds)
    found = run(options.seconds, options.case)
    show(figures_table(found))
    return finish(options.json, found, goals(found))
