"""The side of a child process: events on standard output, commands on standard input, pacing.

Imports nothing of the project, so that peers stay independent of it.
"""

import array
import json
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any


def emit(event: str, **values: object) -> None:
    print(json.dumps({"event": event, **values}), flush=True)


def input_ended() -> threading.Event:
    """Event that is set when standard input ends: the request to end."""
    ended = threading.Event()

    def read() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=read, daemon=True).start()
    return ended


def set_time(stamp: Any, ns: int) -> None:
    stamp.sec, stamp.nanosec = divmod(ns, 10**9)


def paced(count: int, period_ns: float, cycle: Callable[[int], object]) -> "array.array[int]":
    """Call ``cycle`` with the numbers below ``count``, each when it is due on an absolute clock.

    A late cycle delays the next ones; none is skipped. Returns the delay of each call in ns.
    """
    late_ns = array.array("q", bytes(8 * count))  # filled, so that it does not grow meanwhile
    begin_ns = time.monotonic_ns()
    for number in range(count):
        due_ns = begin_ns + round(number * period_ns)
        if (ahead_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(ahead_ns / 1e9)
        late_ns[number] = time.monotonic_ns() - due_ns
        cycle(number)
    return late_ns


def to_and_fro(frame: int, count: int) -> int:
    """Index below ``count`` of a motion that turns round at both ends without a repetition."""
    index = frame % (2 * count - 2)
    return index if index < count else 2 * count - 2 - index


def seq_of(raw: bytes) -> int:
    """``seq`` of a serialised FixtureConstraint, by the CDR layout.

    4 bytes of encapsulation, two 4-byte integers, a string, then ``seq`` aligned to 8.
    """
    (length,) = struct.unpack_from("<I", raw, 12)
    return int(struct.unpack_from("<Q", raw, 4 + -(-(12 + length) // 8) * 8)[0])
