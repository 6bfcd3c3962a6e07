"""Publish the constraint to another process at 1 kHz for a minute, beside a session at 50 Hz.

    marginguard bench rate [--seconds 60] [--case data/recorded_case] [--json FILE]

Three processes run at a time. The sender steps a session with the recorded case's frames in real
time and sends the constraint 1000 times a second. The receiver takes it as bytes. The bare loop
only sleeps from millisecond to millisecond, in the scheduling class of the sending thread
(real-time where allowed), and shows the latency of the machine itself. The receiver is an ordinary
process. All times are of CLOCK_MONOTONIC, which the processes of a machine share.

Messages of the steps are sent in addition to the beats and do not count in their rate. A late beat
is sent late; one that is 10 ms late is skipped.

Exit status 1 when the mean rate of the beats is below 999 Hz, when there is a gap over 10 ms that
is also longer than the bare loop's longest, when a message was lost or duplicated, or when the
99th percentile from sending to receiving is above 2 ms.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from app.cli.progress import announce_duration
from benchmarks.harness.figures import percentiles, show, table
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
        for name in ("sender", "bare"):
            parts[name].expect("done", seconds + 60.0)
        parts["receiver"].send(do="end")
        parts["receiver"].expect("done")
        report = json.loads((folder / "sender.json").read_text())
        sent, received, bare = (
            np.load(folder / f"{name}.npy") for name in ("sent", "received", "bare")
        )
        return figures(sent, received, bare, **report)


def main() -> int:
    parser = BenchParser("rate", __doc__)
    parser.number("--seconds", 60.0, "how long")
    parser.case()
    options = parser.parse_args()
    announce_duration("publishing", options.seconds)
    found = run(options.seconds, options.case)
    rows = {"sent": "sent_gaps", "received": "received_gaps", "bare loop": "bare_gaps"}
    show(
        f"{found['sent']} constraints in {found['seconds']:.2f} s beside {found['steps']} steps\n"
        f"  mean rate               {found['beats_hz']:.2f} Hz by beats alone, "
        f"{found['missed_beats']} left out; {found['mean_hz']:.2f} Hz on the topic\n"
        f"  received                {found['received']}, in order: {found['in_order']}",
        table(
            "gaps",
            ("", "p99 ms", "max ms", "over 10 ms"),
            [(name, *found[key].values()) for name, key in rows.items()],
        ),
        f"  sent to received        p50 {found['delay_p50_ms']:.3f}, "
        f"p99 {found['delay_p99_ms']:.3f}, max {found['delay_max_ms']:.3f} ms\n"
        f"  the sender took         {100.0 * found['sender_cpu_share']:.0f} % of a core",
    )
    return finish(options.json, found, goals(found))


if __name__ == "__main__":
    raise SystemExit(main())
