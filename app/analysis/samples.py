"""The steps of a session as arrays: what the analysis reads, one value per frame."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from app.geometry import NS_PER_S, FloatArray, InputError

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
