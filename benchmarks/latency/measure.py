"""Measurement of one receiver: the sender in a process of its own, the scene here."""

import json
import os
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, closing
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from app.runtime.latest_value import SWITCH_INTERVAL_S
from benchmarks.latency.receivers import Kind, Receiver
from benchmarks.latency.results import Run

CHECKOUT = Path(__file__).resolve().parents[2]
WARM_UP_S = 1.5


class Sender:
    """The sending process. ``report`` is its last line, available once `ended`."""

    def __init__(
        self, kind: Kind, bodies: int, seconds: float, warm_up_s: float = WARM_UP_S
    ) -> None:
        numbers = (bodies, kind.rate_hz, warm_up_s, seconds)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.latency.sender", kind.sends, *map(str, numbers)],
            stdout=subprocess.PIPE,
            text=True,
            cwd=CHECKOUT,
        )
        if self._process.stdout is None:
            raise RuntimeError("the sender has no standard output")
        self._output = self._process.stdout
        listening = self._output.readline()
        self.port: int | None = json.loads(listening)["port"] if listening else None
        self.report: dict[str, Any] = {}
        self._ended = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def ended(self) -> bool:
        """True once it has sent everything or has failed."""
        return self._ended.is_set()

    def _read(self) -> None:
        line = self._output.readline()
        self.report = json.loads(line) if line else {}
        self._ended.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._process.kill()
        self._process.wait()
        self._reader.join()
        self._output.close()


def measure(kind: Kind, seconds: float, bodies: int) -> Run:
    """Run it for the warm-up and ``seconds``; frames sent during the warm-up do not count."""
    rows: list[tuple[int, int]] = []
    switch_interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        with ExitStack() as stack:
            sender = stack.enter_context(Sender(kind, bodies, seconds))
            receiver = stack.enter_context(closing(kind.open(bodies, seconds, sender.port)))
            load = os.getloadavg()[0]
            while not sender.ended:
                _update(receiver, rows)
    finally:
        sys.setswitchinterval(switch_interval_s)
    if not sender.report:
        raise RuntimeError(f"the sender of {kind.name!r} has failed")
    table = np.array(rows, dtype=np.int64).reshape(-1, 2)
    counted_from_ns = sender.report["counted_from_ns"]
    stamps_ns, shown_ns = table[table[:, 0] >= counted_from_ns].T
    arrived = None
    if receiver.arrivals_ns is not None:
        arrived = int((np.array(receiver.arrivals_ns) >= counted_from_ns).sum())
    return Run(kind, sender.report["sent"], arrived, stamps_ns, (shown_ns - stamps_ns) / 1e6, load)


def _update(receiver: Receiver, rows: list[tuple[int, int]]) -> None:
    stamp_ns = receiver.update()
    now_ns = time.time_ns()
    if stamp_ns is not None and (not rows or stamp_ns != rows[-1][0]):
        rows.append((stamp_ns, now_ns))
