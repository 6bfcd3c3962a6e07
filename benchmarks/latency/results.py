"""Results of the receivers, and the requirements on ours."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from benchmarks.fixture.results import SpeedTarget
from benchmarks.latency.kinds import OURS, POLLED, Kind

MAX_MEAN_MS = 2.0
MAX_P99_MS = 5.0
MAX_SHARE_OF_POLLED = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Delays (n,) in ms of the frames that one receiver has shown.

    ``arrived``: number of frames that arrived, None if it cannot be counted. ``transport_ms``: the
    part up to the arrival in the receiver's process, where it is known. ``picture_ms``: delays of
    drawn pictures. ``step_ms``: the part up to the end of the session's step, where there is one.
    ``load``: the machine's load average before.
    """

    kind: Kind
    sent: int
    arrived: int | None
    delays_ms: FloatArray
    load: float
    transport_ms: FloatArray
    picture_ms: FloatArray
    step_ms: FloatArray

    def concatenated(self, later: "Run") -> "Run":
        """Both runs as one."""
        known = self.arrived is not None and later.arrived is not None
        return Run(
            self.kind,
            self.sent + later.sent,
            (self.arrived or 0) + (later.arrived or 0) if known else None,
            np.concatenate([self.delays_ms, later.delays_ms]),
            max(self.load, later.load),
            np.concatenate([self.transport_ms, later.transport_ms]),
            np.concatenate([self.picture_ms, later.picture_ms]),
            np.concatenate([self.step_ms, later.step_ms]),
        )

    @property
    def mean_ms(self) -> float:
        """Mean delay in ms."""
        return float(self.delays_ms.mean())

    def percentile_ms(self, percent: float) -> float:
        """Percentile of the delays in ms."""
        return float(np.percentile(self.delays_ms, percent))

    @property
    def shown(self) -> int:
        """Number of frames that were in the scene."""
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
        return {
            "name": self.kind.name, "what": self.kind.what, "rate_hz": self.kind.rate_hz,
            "sent": self.sent, "shown": self.shown, "superseded": self.superseded,
            "lost": self.lost, "load": self.load,
            "transport_mean_ms": mean_or_none(self.transport_ms),
            "step_mean_ms": mean_or_none(self.step_ms),
            "picture_mean_ms": mean_or_none(self.picture_ms),
            "pictures": len(self.picture_ms),
            "mean_ms": self.mean_ms, "sd_ms": float(self.delays_ms.std()),
            **{f"p{percent}_ms": self.percentile_ms(percent) for percent in (50, 95, 99)},
            "max_ms": self.percentile_ms(100),
            "delays_ms": [round(delay, 3) for delay in self.delays_ms.tolist()],
        }  # fmt: skip


def mean_or_none(values: FloatArray) -> float | None:
    """The mean; None without values."""
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
    stamps: NDArray[np.int64] = np.array([s for s, _ in rows if s >= counted_from_ns], np.int64)
    if arrivals_ns is None or not len(stamps):
        return np.empty(0)
    arrivals: NDArray[np.int64] = np.array(arrivals_ns, np.int64)
    found = np.searchsorted(arrivals, stamps)
    known = found < len(arrivals)
    return np.asarray((arrivals[found[known]] - stamps[known]) / 1e6)


def speed_targets(runs: Mapping[str, Run]) -> Iterator[SpeedTarget]:
    """Requirements on ours, checked against ``runs`` by name."""
    ours, polled = runs[OURS], runs[POLLED]
    share = ours.mean_ms / polled.mean_ms
    yield _target(f"mean at most {MAX_MEAN_MS:g} ms", ours.mean_ms, "ms", MAX_MEAN_MS)
    yield _target(f"p99 at most {MAX_P99_MS:g} ms", ours.percentile_ms(99), "ms", MAX_P99_MS)
    what = "mean at most half that of polling at 200 Hz"
    yield _target(what, share, "of it", MAX_SHARE_OF_POLLED)


def _target(what: str, value: float, unit: str, limit: float) -> SpeedTarget:
    return SpeedTarget(what, f"{value:.3g} {unit}", value <= limit)
