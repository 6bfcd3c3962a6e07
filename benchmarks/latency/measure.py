"""Measurement of one receiver: the sender in a process of its own, the scene here."""

import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from app.runtime.latest_value import SWITCH_INTERVAL_S
from benchmarks.faults.child import Child
from benchmarks.faults.scene import write_scene
from benchmarks.latency.kinds import SESSION_HZ, Kind
from benchmarks.latency.receivers import Receiver
from benchmarks.latency.results import Run, delays_ms, transports_ms
from benchmarks.soak.__main__ import interpolate

CHECKOUT = Path(__file__).resolve().parents[2]
WARM_UP_S = 1.5
SESSION_WARM_UP_S = 3.0
"""A session waits for its clock, its joints and a second driver."""


class Sender:
    """The sending process. ``report`` is its last line, available once `ended`."""

    def __init__(self, module: str, *arguments: object) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"benchmarks.latency.{module}", *map(str, arguments)],
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

    def has_ended(self) -> bool:
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


@contextmanager
def switching_fast() -> Iterator[None]:
    """The interpreter's switch interval of the programs that display live data."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval_s)


def measure(kind: Kind, seconds: float, bodies: int) -> Run:
    """Run it for a warm-up and ``seconds``; frames sent during the warm-up do not count."""
    if kind.sends == "session":
        return _measure_session(kind, seconds, bodies)
    with ExitStack() as stack:
        stack.enter_context(switching_fast())
        arguments = (kind.sends, bodies, kind.rate_hz, WARM_UP_S, seconds)
        sender = stack.enter_context(Sender("sender", *arguments))
        receiver = stack.enter_context(closing(kind.open(bodies, seconds, sender.port)))
        load = os.getloadavg()[0]
        receiver.run(sender.has_ended)
    if not sender.report:
        raise RuntimeError(f"the sender of {kind.name!r} has failed")
    return _run_of(kind, receiver, sender.report["sent"], sender.report["counted_from_ns"], load)


def _run_of(kind: Kind, receiver: Receiver, sent: int, counted_from_ns: int, load: float) -> Run:
    arrivals_ns = receiver.arrivals_ns
    return Run(
        kind,
        sent,
        None if arrivals_ns is None else sum(at_ns >= counted_from_ns for at_ns in arrivals_ns),
        delays_ms(receiver.rows, counted_from_ns),
        load,
        transports_ms(receiver.rows, arrivals_ns, counted_from_ns),
        delays_ms(receiver.pictures, counted_from_ns),
        delays_ms(receiver.steps, counted_from_ns),
    )


def _measure_session(kind: Kind, seconds: float, bodies: int) -> Run:
    """A tracker with three sensors and joints, stamped when they are due, and a session here."""
    with ExitStack() as stack:
        stack.enter_context(switching_fast())
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scene = folder / "scene.json"
        write_scene(scene, time.time_ns())
        interpolate(scene, round(SESSION_HZ))
        peer = str(CHECKOUT / "benchmarks" / "faults" / "tracker_peer.py")
        tracker = Child("tracker", [peer, str(scene)], folder / "tracker.log")
        stack.callback(tracker.end)
        receiver = stack.enter_context(closing(kind.open(bodies, seconds, None)))
        load = os.getloadavg()[0]
        receiver.run(_after_rows(receiver.rows, SESSION_WARM_UP_S + seconds))
    if not receiver.rows:
        raise RuntimeError(f"{kind.name!r} has shown no frame: {tracker.tail()}")
    first_ns, last_ns = receiver.rows[0][0], receiver.rows[-1][0]
    counted_from_ns = first_ns + round(1e9 * SESSION_WARM_UP_S)
    sent = max(0, round((last_ns - counted_from_ns) * SESSION_HZ / 1e9) + 1)
    return _run_of(kind, receiver, sent, counted_from_ns, load)


def _after_rows(rows: Sequence[tuple[int, int]], seconds: float) -> Callable[[], bool]:
    """True ``seconds`` after the first row."""

    def has_ended() -> bool:
        return bool(rows) and time.time_ns() - rows[0][1] > 1e9 * seconds

    return has_ended
