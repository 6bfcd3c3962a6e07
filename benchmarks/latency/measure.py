"""The receivers that are compared, and the measurement of one beside a sending process."""

import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.geometry import FloatArray
from app.runtime.thread_handover import SWITCH_INTERVAL_S
from benchmarks.faults.scene import tracker_arguments
from benchmarks.harness.figures import load
from benchmarks.harness.processes import Child, children
from benchmarks.latency.receivers import KEPT, RELEASED, PlainListener, PolledIgtl, Receiver, Waking
from benchmarks.latency.results import OURS, POLLED, Run, delays_ms, mean_or_none, transports_ms
from benchmarks.latency.senders import body_frames

RATE_HZ = 199.5
"""Not a multiple of a timer's rate: their phases drift through a period every two seconds, so that
the phase, which is random, does not decide the result."""

SESSION_HZ = 200
WARM_UP_S = 1.5
SESSION_WARM_UP_S = 3.0  # a session waits for its clock, its joints and a second driver
STOPS = 15
MOVE_S, REST_S = 0.6, 0.4
STOPS_WARM_UP_S = 3.0  # the receiver reads the description and builds the robots meanwhile
STOPS_HZ = 99.5  # as `RATE_HZ`, for a robot that sends 100 times a second
Open = Callable[[int, int | None], Receiver]  # for a number of bodies and a TCP port


@dataclass(frozen=True, slots=True)
class Kind:
    """A row of the table. ``sends``: ``tf`` or ``igtl``, or ``session`` for a tracker."""

    name: str
    what: str
    sends: str
    open: Open

    @property
    def rate_hz(self) -> float:
        return SESSION_HZ if self.sends == "session" else RATE_HZ


def _qt(name: str, *waking: Any) -> Open:
    """A receiver of `benchmarks.latency.qt_receivers`, which loads when it is made."""

    def opened(bodies: int, port: int | None) -> Receiver:
        from benchmarks.latency import qt_receivers

        frames = (body_frames(bodies),) if name == "BodiesInModule" else ()
        receiver: Receiver = getattr(qt_receivers, name)(*frames, *waking)
        return receiver

    return opened


LISTENER = "rclpy listener"
_MODULE, _PANEL = "BodiesInModule", "PanelReceiver"
KINDS = (
    Kind(LISTENER, "transport alone: rclpy, no scene", "tf", lambda *_: PlainListener()),
    Kind(OURS, "woken by messages", "tf", _qt(_MODULE, Waking(RELEASED))),
    Kind(f"{OURS}, {KEPT}", "the same, loop as PythonQt's", "tf", _qt(_MODULE, Waking(KEPT))),
    Kind(POLLED, "the same module, polled", "tf", _qt(_MODULE, Waking(RELEASED, 5))),
    Kind("timer 20 ms", "polled, as before", "tf", _qt(_MODULE, Waking(RELEASED, 20))),
    Kind(f"timer 20 ms, {KEPT}", "as before, as PythonQt's", "tf", _qt(_MODULE, Waking(KEPT, 20))),
    Kind("OpenIGTLink", "pyigtl, polled at 200 Hz", "igtl", PolledIgtl),
    Kind("panel", "a session, woken", "session", _qt(_PANEL, Waking(RELEASED))),
    Kind(f"panel, {KEPT}", "a session, woken", "session", _qt(_PANEL, Waking(KEPT))),
    Kind("panel, timer 20 ms", "polled, as before", "session", _qt(_PANEL, Waking(RELEASED, 20))),
    Kind("page", "a session in the live page", "session", _qt("PageReceiver")),
)


@contextmanager
def sending(*commands: Sequence[object]) -> Iterator[tuple[list[Child], int | None]]:
    """A process of `benchmarks.latency.senders` for each of ``commands``, and the last one's port.

    An event, or the end of the process, says that it has ended. This interpreter has the switch
    interval of the programs that display live data.
    """
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        with tempfile.TemporaryDirectory() as folder, children(Path(folder)) as (running, start):
            for number, command in enumerate(commands):
                start(f"sender {number}", "-m", "benchmarks.latency.senders", *command)
            senders = list(running.values())
            ports = [sender.expect("listening", 60.0)["port"] for sender in senders]
            yield senders, ports[-1] if ports else None
    finally:
        sys.setswitchinterval(interval_s)


def measure(kind: Kind, seconds: float, bodies: int) -> Run:
    """Run it for a warm-up and ``seconds``; frames sent during the warm-up do not count."""
    if kind.sends == "session":
        return _measure_session(kind, seconds, bodies)
    command = (kind.sends, bodies, kind.rate_hz, WARM_UP_S, seconds)
    with sending(command) as ((sender,), port):
        with closing(kind.open(bodies, port)) as receiver:
            before = load()
            receiver.run(sender.has_event)
        report = sender.expect("sent")
    return _run_of(kind, receiver, report["sent"], report["counted_from_ns"], before)


def _run_of(kind: Kind, receiver: Receiver, sent: int, counted_from_ns: int, before: float) -> Run:
    arrivals_ns = receiver.arrivals_ns
    return Run(
        kind.name,
        kind.what,
        kind.rate_hz,
        sent,
        None if arrivals_ns is None else sum(at_ns >= counted_from_ns for at_ns in arrivals_ns),
        delays_ms(receiver.rows, counted_from_ns),
        before,
        transports_ms(receiver.rows, arrivals_ns, counted_from_ns),
        delays_ms(receiver.pictures, counted_from_ns),
        delays_ms(receiver.steps, counted_from_ns),
    )


def _measure_session(kind: Kind, seconds: float, bodies: int) -> Run:
    """A tracker with three sensors and joints, stamped when they are due, and a session here."""
    with sending(), tempfile.TemporaryDirectory() as folder, children(Path(folder)) as (_, start):
        tracker = start("tracker", *tracker_arguments(Path(folder), SESSION_HZ))
        with closing(kind.open(bodies, None)) as receiver:
            before, rows = load(), receiver.rows
            duration_ns = 1e9 * (SESSION_WARM_UP_S + seconds)
            receiver.run(lambda: bool(rows) and time.time_ns() - rows[0][1] > duration_ns)
        if not rows:
            raise RuntimeError(f"{kind.name!r} has shown no frame: {tracker.tail()}")
    counted_from_ns = rows[0][0] + round(1e9 * SESSION_WARM_UP_S)
    sent = max(0, round((rows[-1][0] - counted_from_ns) * SESSION_HZ / 1e9) + 1)
    return _run_of(kind, receiver, sent, counted_from_ns, before)


@dataclass(frozen=True, slots=True)
class StopKind:
    """Measured module: its waking, its robots, and whether it draws."""

    name: str
    waking: Waking
    robots: tuple[str, ...] = ("left",)
    draws: bool = False


STOP_KINDS = (
    StopKind("module ROS2", Waking(RELEASED)),
    StopKind(f"module ROS2, {KEPT}", Waking(KEPT)),
    StopKind("module ROS2, drawn", Waking(RELEASED), draws=True),
    StopKind("timer 20 ms", Waking(RELEASED, 20)),
    StopKind("two robots", Waking(RELEASED), robots=("left", "right")),
    StopKind("two robots, timer 20 ms", Waking(RELEASED, 20), robots=("left", "right")),
)


@dataclass(frozen=True, slots=True, eq=False)
class StopRun:
    """Delays in ms of one robot: at its stops, of all frames, and of pictures drawn at stops."""

    kind: StopKind
    robot: str
    stops_ms: FloatArray
    frames_ms: FloatArray
    pictures_ms: FloatArray
    load: float

    @property
    def name(self) -> str:
        return f"{self.kind.name}: {self.robot}" if len(self.kind.robots) > 1 else self.kind.name

    def document(self) -> dict[str, object]:
        return {
            "name": self.name, "load": self.load, "stops": len(self.stops_ms),
            "stop_mean_ms": float(self.stops_ms.mean()), "stop_sd_ms": float(self.stops_ms.std()),
            "stop_max_ms": float(self.stops_ms.max()),
            "frame_mean_ms": float(self.frames_ms.mean()),
            "frame_p99_ms": float(np.percentile(self.frames_ms, 99)),
            "picture_mean_ms": mean_or_none(self.pictures_ms),
            "picture_sd_ms": float(self.pictures_ms.std()) if len(self.pictures_ms) else None,
            "stops_ms": [round(delay, 3) for delay in self.stops_ms.tolist()],
        }  # fmt: skip


def measure_stops(kind: StopKind, stops: int = STOPS) -> list[StopRun]:
    """Let each robot of ``kind`` stop ``stops`` times; one result for each robot."""
    from benchmarks.latency.qt_receivers import RobotsInModule

    commands = [(name, STOPS_HZ, STOPS_WARM_UP_S, stops, MOVE_S, REST_S) for name in kind.robots]
    with sending(*commands) as (senders, _):
        robots = RobotsInModule(kind.robots, kind.waking, draws=kind.draws)
        with closing(robots) as receiver:
            before = load()
            receiver.run(lambda: all(sender.has_event() for sender in senders))
        reports = [sender.expect("sent") for sender in senders]
    runs = []
    for name, report in zip(kind.robots, reports, strict=True):
        rows = receiver.rows_of[name]
        rests_ns = report["rests_ns"]
        pictures = delays_at(rests_ns, receiver.pictures) if kind.draws else np.empty(0)
        frames = delays_ms(rows, report["counted_from_ns"])
        runs.append(StopRun(kind, name, delays_at(rests_ns, rows), frames, pictures, before))
    return runs


def delays_at(stamps_ns: Sequence[int], rows: Sequence[tuple[int, int]]) -> FloatArray:
    """Time in ms from each stamp until a row with this stamp or a later one."""
    shown = np.array(rows, dtype=np.int64).reshape(-1, 2)
    found = np.searchsorted(shown[:, 0], np.array(stamps_ns, dtype=np.int64))
    if len(rows) == 0 or found.max(initial=0) >= len(shown):
        raise RuntimeError("a stop was not shown; expected every stop in the scene")
    return np.asarray((shown[found, 1] - np.array(stamps_ns)) / 1e6)
