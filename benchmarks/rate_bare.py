"""Process of `benchmarks.rate` that sleeps from millisecond to millisecond and records wake-ups.

Uses the real-time class of the sending thread, so that the two are comparable.
"""

import sys
import time
from pathlib import Path

import numpy as np

from app.bridge.heartbeat import ask_for_real_time

PERIOD_NS = 1_000_000


def main() -> int:
    folder, seconds = Path(sys.argv[1]), float(sys.argv[2])
    woke_ns = np.zeros(round(seconds * 1e9 / PERIOD_NS), dtype=np.int64)
    ask_for_real_time()
    print("ready", flush=True)
    sys.stdin.readline()
    begin_ns = time.monotonic_ns()
    for beat in range(len(woke_ns)):
        ahead_ns = begin_ns + beat * PERIOD_NS - time.monotonic_ns()
        if ahead_ns > 0:
            time.sleep(ahead_ns / 1e9)
        woke_ns[beat] = time.monotonic_ns()
    np.save(folder / "bare.npy", woke_ns)
    print("done", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
