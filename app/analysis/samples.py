"""The steps of a session as arrays, one value per frame, and the breaches among them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from app.geometry import NS_PER_S, FloatArray, InputError
from app.session import InsideRun, InsideRuns

if TYPE_CHECKING:
    from app.session import StepResult

SampleRow = tuple[int, int, bool, tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class DistanceSample:
    """One frame for `find_breaches`: ``signed_distance_mm`` is None where it is not known."""

    stamp_ns: int
    signed_distance_mm: float | None


@dataclass(frozen=True, slots=True, eq=False)
class CaseSamples:
    """The frames of a case; unknown numbers are NaN. Lengths in mm, in the tumour's frame.

    ``stamps_ns`` (n,) are int64. ``states`` (n,) are values of `MarginState`. ``distances_mm`` (n,)
    and ``stop_mm`` (n,), the applied stop margin. ``tips_mm`` (n, 3) and ``rotations`` (n, 3, 3)
    are the pose ``tumor_from_tip``. ``on_tumor_mm`` (n, 3): the surface point of the tumour closest
    to the tool; ``on_tool_mm`` (n, 3): the nearest or deepest point of the tool, in the tip's
    frame. ``normals`` (n, 3): outward, at the tumour's point. ``between`` (n,): the
    distance is that of the path since the last frame.
    """

    stamps_ns: NDArray[np.int64]
    states: NDArray[np.int8]
    distances_mm: FloatArray
    stop_mm: FloatArray
    tips_mm: FloatArray
    rotations: FloatArray
    on_tumor_mm: FloatArray
    on_tool_mm: FloatArray
    normals: FloatArray
    between: NDArray[np.bool_]

    @classmethod
    def from_steps(cls, steps: "Iterable[StepResult]") -> "CaseSamples":
        """Read the steps once; raises `InputError` without a step."""
        return cls.from_rows(list(map(sample_row, steps)))

    @classmethod
    def from_rows(cls, rows: "Sequence[SampleRow]") -> "CaseSamples":
        """Join what `sample_row` returned for each step; raises `InputError` without a row."""
        if not rows:
            raise InputError("steps: there are 0; expected at least 1")
        stamps, states, between, numbers = zip(*rows, strict=True)
        values = np.array(numbers, dtype=np.float64)
        values[~np.isfinite(values)] = np.nan
        return cls(
            np.array(stamps, dtype=np.int64),
            np.array(states, dtype=np.int8),
            values[:, 0],
            values[:, 1],
            values[:, 2:5],
            values[:, 5:14].reshape(-1, 3, 3),
            values[:, 14:17],
            values[:, 17:20],
            values[:, 20:23],
            np.array(between, dtype=bool),
        )

    @property
    def times_s(self) -> FloatArray:
        """Seconds since the first frame, (n,)."""
        return np.asarray((self.stamps_ns - self.stamps_ns[0]) / NS_PER_S)

    @property
    def held_s(self) -> FloatArray:
        """Duration of each frame (n,): until the next one; 0 for the last and for a jump back."""
        return np.append(np.maximum(np.diff(self.stamps_ns), 0) / NS_PER_S, 0.0)

    def rows(self) -> list[DistanceSample]:
        """The frames for `find_breaches`."""
        return [
            DistanceSample(stamp, None if math.isnan(distance) else distance)
            for stamp, distance in zip(
                self.stamps_ns.tolist(), self.distances_mm.tolist(), strict=True
            )
        ]

    def measured(self) -> NDArray[np.intp]:
        """Indices of frames whose own distance is known and whose stamps increase."""
        known = np.flatnonzero(np.isfinite(self.distances_mm) & ~self.between)
        if len(known) == 0:
            return known
        highest = np.maximum.accumulate(self.stamps_ns[known])
        later = np.append(True, self.stamps_ns[known][1:] > highest[:-1])
        return np.asarray(known[later])


def sample_row(step: "StepResult") -> SampleRow:
    """The row of `CaseSamples` for one step: stamp, state, between, and 23 numbers."""
    step = step.of_tumor
    decision, pose = step.decision, step.tumor_from_tip
    numbers = [math.nan] * 23
    if decision.margin is not None:
        numbers[1] = decision.margin.total_mm
    if pose is not None:
        numbers[2:5] = pose.translation_mm.tolist()
        numbers[5:14] = pose.rotation.ravel().tolist()
    proximity = decision.proximity
    if proximity is not None and math.isfinite(proximity.signed_distance_mm):
        numbers[0] = proximity.signed_distance_mm
        numbers[14:17] = proximity.on_tumor_mm.tolist()
        numbers[20:23] = proximity.normal.tolist()
        if pose is not None and step.between_frames is None:
            on_tool = pose.rotation.T.dot(proximity.on_tool_mm - pose.translation_mm)
            numbers[17:20] = on_tool.tolist()
    between = step.between_frames is not None
    return step.frame.stamp.ns, int(decision.state), between, tuple(numbers)


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
    runs: list[list[tuple[float, int]]] = []
    for index, row in enumerate(rows):
        distance_mm = row.signed_distance_mm
        found = rule.observe(row.stamp_ns, distance_mm)
        if found is InsideRun.BEGINS:
            runs.append([])
        if distance_mm is not None and found in (InsideRun.BEGINS, InsideRun.CONTINUES):
            runs[-1].append((distance_mm, index))
    return tuple(_breach(rows, run) for run in runs)


def _breach(rows: Sequence[DistanceRow], run: list[tuple[float, int]]) -> Breach:
    first_ns, first, last = rows[0].stamp_ns, run[0][1], run[-1][1]
    depth, deepest = min(run)
    return Breach(
        start_s=(rows[first].stamp_ns - first_ns) / NS_PER_S,
        end_s=(rows[last].stamp_ns - first_ns) / NS_PER_S,
        min_signed_distance_mm=depth,
        deepest=deepest,
        frames=len(run),
        first=first,
        last=last,
    )
