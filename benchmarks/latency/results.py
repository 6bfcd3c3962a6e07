"""Results of the receivers as tables and plain values, and the requirements on ours."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.geometry import FloatArray
from benchmarks.harness.figures import percentiles
from benchmarks.harness.goals import Goal, at_most
from benchmarks.harness.plots import write_dots, write_histograms

OURS, POLLED = "module ROS2", "timer 5 ms"
MAX_MEAN_MS = 2.0
MAX_P99_MS = 5.0
MAX_SHARE_OF_POLLED = 0.5
DELAYS_PNG, STOPS_PNG = "latency.png", "latency_stops.png"
NOTES = """\
Time from the stamp of a frame, made in another process, to the end of the update of the MRML scene
and of all observers. Transport: the part up to the callback in this process. Step: the part up to
the end of the session's step, with a late sender and transport. Picture: to the end of drawing.
Superseded: replaced by a newer frame before it was shown, which is intended. Lock kept: Qt's loop
keeps Python's lock while it waits, as PythonQt in desktop Slicer does; a double of it.
Clock: the machine's own, shared by all processes.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Delays (n,) in ms of the frames that one receiver has shown.

    ``arrived``: number of frames that arrived, None if it cannot be counted. ``transport_ms``: the
    part up to the arrival in the receiver's process, where it is known. ``picture_ms``: delays of
    drawn pictures. ``step_ms``: the part up to the end of the session's step, where there is one.
    ``load``: the machine's load average before.
    """

    name: str
    what: str
    rate_hz: float
    sent: int
    arrived: int | None
    delays_ms: FloatArray
    load: float
    transport_ms: FloatArray
    picture_ms: FloatArray
    step_ms: FloatArray

    def concatenated(self, later: "Run") -> "Run":
        known = self.arrived is not None and later.arrived is not None
        joined = {
            name: np.concatenate([getattr(self, name), getattr(later, name)])
            for name in ("delays_ms", "transport_ms", "picture_ms", "step_ms")
        }
        arrived = (self.arrived or 0) + (later.arrived or 0) if known else None
        before = max(self.load, later.load)
        return replace(self, sent=self.sent + later.sent, arrived=arrived, load=before, **joined)

    @property
    def mean_ms(self) -> float:
        return float(self.delays_ms.mean())

    @property
    def shown(self) -> int:
        return len(self.delays_ms)

    @property
    def lost(self) -> int | None:
        """Number of sent frames that never arrived; None if unknown."""
        return None if self.arrived is None else max(0, self.sent - self.arrived)

    @property
    def superseded(self) -> int:
        """Number of frames replaced by a newer one before they were shown.

        Includes the lost frames if `lost` is None.
        """
        return self.sent - self.shown - (self.lost or 0)

    def document(self) -> dict[str, Any]:
        """Plain values for a JSON file; delays to a microsecond."""
        p50, p95, p99, largest = percentiles(self.delays_ms, 50, 95, 99, 100)
        return {
            "name": self.name, "what": self.what, "rate_hz": self.rate_hz,
            "sent": self.sent, "shown": self.shown, "superseded": self.superseded,
            "lost": self.lost, "load": self.load,
            "transport_mean_ms": mean_or_none(self.transport_ms),
            "step_mean_ms": mean_or_none(self.step_ms),
            "picture_mean_ms": mean_or_none(self.picture_ms),
            "pictures": len(self.picture_ms),
            "mean_ms": self.mean_ms, "sd_ms": float(self.delays_ms.std()),
            "p50_ms": p50, "p95_ms": p95, "p99_ms": p99, "max_ms": largest,
            "delays_ms": [round(delay, 3) for delay in self.delays_ms.tolist()],
        }  # fmt: skip


def mean_or_none(values: FloatArray) -> float | None:
    return float(values.mean()) if len(values) else None


def delays_ms(rows: Sequence[tuple[int, int]], counted_from_ns: int) -> FloatArray:
    """Delays of the frames with stamps from ``counted_from_ns`` on."""
    table = np.array(rows, dtype=np.int64).reshape(-1, 2)
    stamps_ns, shown_ns = table[table[:, 0] >= counted_from_ns].T
    return np.asarray((shown_ns - stamps_ns) / 1e6)


def transports_ms(
    rows: Sequence[tuple[int, int]], arrivals_ns: Sequence[int] | None, counted_from_ns: int
) -> FloatArray:
    """Time from the stamp of each shown frame to the next arrival of a message."""
    stamps = np.array([s for s, _ in rows if s >= counted_from_ns], np.int64)
    if arrivals_ns is None or not len(stamps):
        return np.empty(0)
    arrivals = np.array(arrivals_ns, np.int64)
    found = np.searchsorted(arrivals, stamps)
    known = found < len(arrivals)
    return np.asarray((arrivals[found[known]] - stamps[known]) / 1e6)


def goals(runs: Mapping[str, Run]) -> Iterator[Goal]:
    """Requirements on ours, checked against ``runs`` by name; none without ours and polling."""
    if not {OURS, POLLED} <= runs.keys():
        return
    ours, polled = runs[OURS], runs[POLLED]
    (p99,) = percentiles(ours.delays_ms, 99)
    share = ours.mean_ms / polled.mean_ms
    yield at_most("mean", ours.mean_ms, MAX_MEAN_MS, "ms", ".3g")
    yield at_most("p99", p99, MAX_P99_MS, "ms", ".3g")
    yield at_most("mean", share, MAX_SHARE_OF_POLLED, "of that of polling at 200 Hz", ".3g")


RUN_COLUMNS = {
    "receiver": "name", "what": "what", "mean": "mean_ms", "sd": "sd_ms", "p50": "p50_ms",
    "p95": "p95_ms", "p99": "p99_ms", "max": "max_ms", "transport": "transport_mean_ms",
    "step": "step_mean_ms", "picture": "picture_mean_ms", "sent": "sent", "shown": "shown",
    "superseded": "superseded", "lost": "lost", "load": "load",
}  # fmt: skip
STOP_COLUMNS = {
    "receiver": "name", "stops": "stops", "mean": "stop_mean_ms", "sd": "stop_sd_ms",
    "max": "stop_max_ms", "all frames: mean": "frame_mean_ms", "p99": "frame_p99_ms",
    "picture: mean": "picture_mean_ms", "sd ": "picture_sd_ms", "load": "load",
}  # fmt: skip


def write_plots(runs: Sequence[Run], stops: Sequence[Any], folder: Path) -> None:
    """Write the delays of each receiver, and those at the stops of a robot."""
    delays = {run.name: run.delays_ms for run in runs}
    write_histograms(folder / DELAYS_PNG, delays, "stamp to scene [ms]; dashed: the mean")
    shown = {run.name: run.stops_ms for run in stops}
    shown |= {f"{run.name}: picture": run.pictures_ms for run in stops if len(run.pictures_ms)}
    label = "delay at a stop [ms]; bar: mean and standard deviation"
    write_dots(folder / STOPS_PNG, shown, label)
