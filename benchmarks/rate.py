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
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.bridge.environment import prepare_environment
from app.cli.progress import announce_duration
from benchmarks.case_options import case_options

RATE_HZ = 1000
MIN_MEAN_HZ = 999.0
MAX_GAP_MS = 10.0
MAX_P99_MS = 2.0

Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Gaps:
    """Gaps between consecutive times: 99th percentile, longest, and number above 10 ms."""

    p99_ms: float
    max_ms: float
    over_10_ms: int

    @classmethod
    def of(cls, times_ns: Times) -> "Gaps":
        """Gaps of sorted times (n,) in ns."""
        gaps_ms = np.diff(times_ns) / 1e6
        p99, longest = np.percentile(gaps_ms, [99, 100])
        return cls(float(p99), float(longest), int((gaps_ms > MAX_GAP_MS).sum()))


@dataclass(frozen=True, slots=True)
class Figures:
    """Results of one run; delays are from just before sending to the receiver's callback."""

    seconds: float
    sent: int
    received: int
    in_order: bool
    mean_hz: float
    beats_hz: float
    missed_beats: int
    sent_gaps: Gaps
    received_gaps: Gaps
    bare_gaps: Gaps
    delay_p50_ms: float
    delay_p99_ms: float
    delay_max_ms: float
    steps: int
    sender_cpu_share: float


def figures(
    sent_ns: Times, received: Times, bare_ns: Times, *, missed: int, steps: int, cpu_s: float
) -> Figures:
    """Figures of sending times (n,) by seq, rows (m, 2) of seq and arrival, and the bare loop's."""
    seqs, arrived_ns = received[:, 0], received[:, 1]
    known = (seqs >= 0) & (seqs < len(sent_ns))
    delays_ms = (arrived_ns[known] - sent_ns[seqs[known]]) / 1e6
    p50, p99, longest = np.percentile(delays_ms, [50, 99, 100])
    seconds = float(sent_ns[-1] - sent_ns[0]) / 1e9
    return Figures(
        seconds=seconds,
        sent=len(sent_ns),
        received=len(received),
        in_order=bool(np.array_equal(seqs, np.arange(len(sent_ns)))),
        mean_hz=(len(sent_ns) - 1) / seconds,
        beats_hz=(len(sent_ns) - 1 - steps) / seconds,
        missed_beats=missed,
        sent_gaps=Gaps.of(sent_ns),
        received_gaps=Gaps.of(arrived_ns),
        bare_gaps=Gaps.of(bare_ns),
        delay_p50_ms=float(p50),
        delay_p99_ms=float(p99),
        delay_max_ms=float(longest),
        steps=steps,
        sender_cpu_share=cpu_s / seconds,
    )


def failures(found: Figures) -> list[str]:
    """Missed requirements, one sentence each."""
    wrong = []
    if found.beats_hz < MIN_MEAN_HZ:
        wrong.append(
            f"the beats' rate is {found.beats_hz:.2f} Hz; expected at least {MIN_MEAN_HZ} Hz"
        )
    if found.sent_gaps.max_ms > max(MAX_GAP_MS, found.bare_gaps.max_ms):
        wrong.append(
            f"a gap of {found.sent_gaps.max_ms:.2f} ms; expected at most {MAX_GAP_MS} ms, "
            f"or the bare loop's {found.bare_gaps.max_ms:.2f} ms"
        )
    if not found.in_order:
        wrong.append(f"{found.received} of {found.sent} messages were received, or not in order")
    if found.delay_p99_ms > MAX_P99_MS:
        wrong.append(
            f"p99 of the delay is {found.delay_p99_ms:.3f} ms; expected at most {MAX_P99_MS} ms"
        )
    return wrong


def run(seconds: float, case: Path) -> Figures:
    """Start the processes, wait for them, and read their results."""
    environment = {
        **os.environ,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    }
    prepare_environment(environment)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def start(part: str) -> subprocess.Popen[str]:
            arguments = [str(folder), str(seconds), str(case)]
            return subprocess.Popen(
                [sys.executable, "-m", f"benchmarks.rate_{part}", *arguments],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )

        parts = [start("receiver"), start("sender"), start("bare")]
        try:
            for part in parts:
                wait_for_line(
                    part, "ready"
                )  # loaded; sender and receiver have discovered each other
            for part in parts:
                send_line(part, "go")
            for part in parts[1:]:
                wait_for_line(part, "done")
            send_line(parts[0], "end")
            for part in parts:
                if part.wait() != 0:
                    raise RuntimeError(f"{part.args} ended with status {part.returncode}")
        finally:
            for part in parts:
                part.kill()
                part.communicate()
        report = json.loads((folder / "sender.json").read_text())
        return figures(
            np.load(folder / "sent.npy"),
            np.load(folder / "received.npy"),
            np.load(folder / "bare.npy"),
            missed=report["missed"],
            steps=report["steps"],
            cpu_s=report["cpu_s"],
        )


def wait_for_line(part: subprocess.Popen[str], word: str) -> None:
    """Wait until the process prints ``word``; raises `RuntimeError` if it ends before."""
    assert part.stdout is not None
    for line in part.stdout:
        if line.strip() == word:
            return
    raise RuntimeError(f"{part.args} ended before it was {word}")


def send_line(part: subprocess.Popen[str], word: str) -> None:
    """Write one line to the process's standard input."""
    assert part.stdin is not None
    part.stdin.write(word + "\n")
    part.stdin.flush()


def main() -> int:
    options = case_options("rate", __doc__)
    announce_duration("publishing", options.seconds)
    found = run(options.seconds, options.case)
    print(f"{found.sent} constraints in {found.seconds:.2f} s beside {found.steps} steps")
    print(
        f"  mean rate               {found.beats_hz:.2f} Hz by beats alone, "
        f"{found.missed_beats} left out; {found.mean_hz:.2f} Hz on the topic"
    )
    print(f"  received                {found.received}, in order: {found.in_order}")
    print("  gaps                    p99 ms   max ms   over 10 ms")
    for name, gaps in (
        ("sent", found.sent_gaps),
        ("received", found.received_gaps),
        ("bare loop", found.bare_gaps),
    ):
        print(f"    {name:<20}{gaps.p99_ms:>8.3f}{gaps.max_ms:>9.3f}{gaps.over_10_ms:>9}")
    print(
        f"  sent to received        p50 {found.delay_p50_ms:.3f}, p99 {found.delay_p99_ms:.3f}, "
        f"max {found.delay_max_ms:.3f} ms"
    )
    print(f"  the sender took         {100.0 * found.sender_cpu_share:.0f} % of a core")
    wrong = failures(found)
    if options.json is not None:
        options.json.write_text(json.dumps({**asdict(found), "failures": wrong}, indent=1) + "\n")
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main())
