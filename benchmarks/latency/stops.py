"""A joint that starts and stops, and two robots at once, in the module ROS2.

The delay at a stop is the time from the stamp of the first pose of a rest to the end of the update
of the scene that shows this pose, and to the end of the picture where one is drawn.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.geometry import FloatArray
from benchmarks.harness.figures import load
from benchmarks.harness.plots import write_dots, write_histograms
from benchmarks.latency.measure import sending
from benchmarks.latency.qt_loops import KEPT, RELEASED, Waking
from benchmarks.latency.results import Run, delays_ms, mean_or_none

DELAYS_PNG, STOPS_PNG = "latency.png", "latency_stops.png"
STOPS = 15
MOVE_S, REST_S = 0.6, 0.4
WARM_UP_S = 3.0
"""The receiver reads the description and builds the robots meanwhile."""

RATE_HZ = 99.5
"""As `benchmarks.latency.measure.RATE_HZ`, for a robot that sends 100 times a second."""


@dataclass(frozen=True, slots=True)
class StopKind:
    """How the module is woken, and what it shows."""

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
        """The kind, and the robot if there are several."""
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

    commands = [(name, RATE_HZ, WARM_UP_S, stops, MOVE_S, REST_S) for name in kind.robots]
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


def write_plots(runs: Sequence[Run], stops: Sequence[StopRun], folder: Path) -> None:
    """Write the delays of each receiver, and those at the stops of a robot."""
    delays = {run.name: run.delays_ms for run in runs}
    write_histograms(folder / DELAYS_PNG, delays, "stamp to scene [ms]; dashed: the mean")
    shown = {run.name: run.stops_ms for run in stops}
    shown |= {f"{run.name}: picture": run.pictures_ms for run in stops if len(run.pictures_ms)}
    label = "delay at a stop [ms]; bar: mean and standard deviation"
    write_dots(folder / STOPS_PNG, shown, label)
