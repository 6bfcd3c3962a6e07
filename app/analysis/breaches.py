"""Breaches: the time intervals in which the tool is in the tumour."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from app.geometry import NS_PER_S
from app.session import InsideRun, InsideRuns


class DistanceRow(Protocol):
    """One frame: its stamp, its signed distance in mm, or None."""

    @property
    def stamp_ns(self) -> int:
        """Stamp in ns."""

    @property
    def signed_distance_mm(self) -> float | None:
        """Signed distance, None where it is not known."""


@dataclass(frozen=True, slots=True)
class Breach:
    """A maximal run of inside frames; times in seconds from the first frame of the replay.

    ``start_s`` is the first inside frame, ``end_s`` the last one; ``deepest`` is the index of the
    row with ``min_signed_distance_mm`` (negative: a depth), ``frames`` the number of inside frames;
    ``first`` and ``last`` are the indices of its ends.

    >>> import marginguard as mg
    >>> case = mg.open_case(mg.example_case())
    >>> breach = mg.find_breaches(case, mg.replay(case, start_s=95.0, end_s=100.0))[0]
    >>> round(breach.duration_s, 1), breach.frames
    (1.0, 40)
    """

    start_s: float
    end_s: float
    min_signed_distance_mm: float
    deepest: int
    frames: int
    first: int
    last: int

    @property
    def duration_s(self) -> float:
        """From the first to the last inside frame: 0 for a breach of a single frame."""
        return self.end_s - self.start_s


def find_breaches(rows: Sequence[DistanceRow], stale_after_ns: int) -> tuple[Breach, ...]:
    """Find the breaches among ``rows``, in the order of time.

    `InsideRuns` is the rule: computed from the raw signed distance and not from the state. A frame
    without a distance neither begins nor ends a breach, and a gap of more than ``stale_after_ns``
    divides one.
    """
    rule = InsideRuns(stale_after_ns)
    runs: list[list[int]] = []
    for index, row in enumerate(rows):
        found = rule.observe(row.stamp_ns, row.signed_distance_mm)
        if found is InsideRun.BEGINS:
            runs.append([index])
        elif found is InsideRun.CONTINUES:
            runs[-1].append(index)
    return tuple(_breach(rows, run) for run in runs)


def _breach(rows: Sequence[DistanceRow], run: list[int]) -> Breach:
    first_ns = rows[0].stamp_ns
    depth, deepest = min((distance, index) for index, distance in _distances(rows, run))
    return Breach(
        start_s=(rows[run[0]].stamp_ns - first_ns) / NS_PER_S,
        end_s=(rows[run[-1]].stamp_ns - first_ns) / NS_PER_S,
        min_signed_distance_mm=depth,
        deepest=deepest,
        frames=len(run),
        first=run[0],
        last=run[-1],
    )


def _distances(rows: Sequence[DistanceRow], run: list[int]) -> list[tuple[int, float]]:
    return [
        (index, distance)
        for index in run
        if (distance := rows[index].signed_distance_mm) is not None
    ]
