"""What the ways showed, and what is wanted of ours."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from benchmarks.fixture.results import SpeedTarget
from benchmarks.latency.ways import OURS, POLLED, Kind

MOST_MEAN_MS = 2.0
MOST_P99_MS = 5.0
MOST_OF_POLLED = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The frames (n,) of one way that were shown: their stamps, and how late they were in place.

    ``arrived`` is None where it cannot be known; ``load`` is the machine's load average before.
    """

    kind: Kind
    sent: int
    arrived: int | None
    stamps_ns: NDArray[np.int64]
    delays_ms: FloatArray
    load: float

    def joined(self, later: "Run") -> "Run":
        """Both as one."""
        known = self.arrived is not None and later.arrived is not None
        return Run(
            self.kind,
            self.sent + later.sent,
            (self.arrived or 0) + (later.arrived or 0) if known else None,
            np.concatenate([self.stamps_ns, later.stamps_ns]),
            np.concatenate([self.delays_ms, later.delays_ms]),
            max(self.load, later.load),
        )

    @property
    def mean_ms(self) -> float:
        """The mean delay."""
        return float(self.delays_ms.mean())

    def percentile_ms(self, percent: float) -> float:
        """The delay that so many of 100 frames do not exceed."""
        return float(np.percentile(self.delays_ms, percent))

    @property
    def shown(self) -> int:
        """How many frames were in the scene at some time."""
        return len(self.delays_ms)

    @property
    def lost(self) -> int | None:
        """Sent, and never arrived."""
        return None if self.arrived is None else max(0, self.sent - self.arrived)

    @property
    def superseded(self) -> int:
        """Never shown because a newer one was there first; with the lost ones where those are not
        known.
        """
        return self.sent - self.shown - (self.lost or 0)

    @property
    def late(self) -> int:
        """Shown when the next frame had been sent already."""
        return int((self.delays_ms > 1e3 / self.kind.rate_hz).sum())

    def document(self) -> dict[str, Any]:
        """Plain values for a JSON file; delays to a microsecond."""
        return {
            "name": self.kind.name, "what": self.kind.what,
            "rate_hz": self.kind.rate_hz, "poll_hz": self.kind.poll_hz,
            "sent": self.sent, "shown": self.shown, "superseded": self.superseded,
            "lost": self.lost, "late": self.late, "load": self.load,
            "mean_ms": self.mean_ms, "sd_ms": float(self.delays_ms.std()),
            **{f"p{percent}_ms": self.percentile_ms(percent) for percent in (50, 95, 99)},
            "max_ms": self.percentile_ms(100),
            "delays_ms": [round(delay, 3) for delay in self.delays_ms.tolist()],
        }  # fmt: skip


def wishes(runs: Mapping[str, Run]) -> Iterator[SpeedTarget]:
    """What is asked of ours, beside what ``runs``, by name, show."""
    ours, polled = runs[OURS], runs[POLLED]
    share = ours.mean_ms / polled.mean_ms
    yield _wish(f"mean at most {MOST_MEAN_MS:g} ms", ours.mean_ms, "ms", MOST_MEAN_MS)
    yield _wish(f"p99 at most {MOST_P99_MS:g} ms", ours.percentile_ms(99), "ms", MOST_P99_MS)
    yield _wish("mean at most half that of polling at 200 Hz", share, "of it", MOST_OF_POLLED)


def _wish(what: str, value: float, unit: str, most: float) -> SpeedTarget:
    return SpeedTarget(what, f"{value:.3g} {unit}", value <= most)
