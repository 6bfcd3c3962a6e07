"""Where a tracked stylus dwelt: the tip still while the shaft turns about it.

That is how a hand marks a landmark (PLUS finds them so). A stylus that lies on the table is still
all over and is no landmark, nor is one that passes by. The position is taken as a live capture
takes it, from the first ``dwell_s`` after the tip came to rest: a hand that goes on turning leans,
and the error of the tip's calibration grows with the lean.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from app.geometry import NS_PER_S, FloatArray, FrameError, Stamp, TrackedTransform
from app.registration.errors import ShapeError
from app.registration.poses import usable_poses
from app.registration.uncertainty.result import read_only


@dataclass(frozen=True, slots=True)
class DwellSettings:
    """What counts as a dwell.

    The tip, averaged over ``window_s``, stays in a box of ``tip_box_mm`` for ``dwell_s`` at least,
    no two samples being further apart in time than ``max_gap_s``; meanwhile the stylus turns by
    ``min_turn_rad`` (0.3 rad move a point 100 mm up the shaft by 30 mm; 0 for a tool that is held
    still). A dwell nearer than ``spacing_mm`` to an earlier one is on the same
    landmark and is left out.
    """

    window_s: float = 0.2
    dwell_s: float = 1.0
    tip_box_mm: float = 1.5
    min_turn_rad: float = 0.3
    spacing_mm: float = 10.0
    max_gap_s: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ShapeError(f"{field.name} of a dwell is {value}: 0 or more wanted")
        if self.window_s > self.dwell_s:
            raise ShapeError(f"window_s {self.window_s} is longer than dwell_s {self.dwell_s}")


@dataclass(frozen=True, slots=True, eq=False)
class Dwell:
    """The tip (3,) in mm in the samples' target frame, the mean of ``count`` samples.

    ``spread_mm`` is their RMS distance from it. ``start``, ``end`` and ``turn_rad``, the largest
    turn of the stylus, are of the whole stretch in which the tip kept still.
    """

    position_mm: FloatArray
    start: Stamp
    end: Stamp
    count: int
    spread_mm: float
    turn_rad: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "position_mm", read_only(self.position_mm))


def detect_dwells(
    reference_from_tip: Sequence[TrackedTransform], settings: DwellSettings | None = None
) -> tuple[Dwell, ...]:
    """The dwells in a recording of a stylus tip, in time order; empty when there is none.

    Samples that are not OK are left out. Raises `NoValidSamplesError` when none is OK, and
    `FrameError` when they are between different frames.
    """
    chosen = settings or DwellSettings()
    poses = usable_poses(reference_from_tip)
    names = {(pose.target, pose.source) for pose in poses}
    if len(names) > 1:
        raise FrameError(f"samples of a stylus are between different frames: {sorted(names)}")
    stamps = [sample.stamp for sample in reference_from_tip if sample.transform is not None]
    times = np.array([stamp.ns - stamps[0].ns for stamp in stamps]) / NS_PER_S
    if np.any(np.diff(times) < 0.0):
        late = int(np.argmin(np.diff(times))) + 1
        raise ShapeError(f"good sample {late} of a stylus goes back in time: time order wanted")
    tips = np.stack([pose.translation_mm for pose in poses])
    rotations = np.stack([pose.rotation for pose in poses])

    dwells: list[Dwell] = []
    for run in _still_runs(times, tips, chosen):
        turn = _largest_turn(rotations[run])
        # At the edge of a run the moving mean still holds samples of the approach.
        since_rest = times[run] - times[run[0]] - 0.5 * chosen.window_s
        taken = tips[run[(since_rest >= 0.0) & (since_rest <= chosen.dwell_s)]]
        position = taken.mean(axis=0)
        visited = any(
            np.linalg.norm(dwell.position_mm - position) < chosen.spacing_mm for dwell in dwells
        )
        if turn < chosen.min_turn_rad or visited:
            continue
        dwells.append(
            Dwell(
                position_mm=position,
                start=stamps[run[0]],
                end=stamps[run[-1]],
                count=len(taken),
                spread_mm=float(np.sqrt(np.sum(np.var(taken, axis=0)))),
                turn_rad=turn,
            )
        )
    return tuple(dwells)


def _still_runs(
    times: FloatArray, tips: FloatArray, settings: DwellSettings
) -> list[NDArray[np.intp]]:
    """Indices of the samples of each stretch in which the tip keeps still."""
    smooth = _moving_mean(times, tips, settings.window_s)
    last = np.searchsorted(times, times + settings.dwell_s, side="left")
    still = np.zeros(len(times), dtype=bool)
    # A gap in the samples is no proof of stillness: nothing is known of the tip in it.
    gap_ends = np.flatnonzero(np.diff(times) > settings.max_gap_s) + 1
    for first, end in enumerate(last):
        if end == len(times) or np.any((gap_ends > first) & (gap_ends <= end)):
            continue
        window = smooth[first : end + 1]
        if float(np.ptp(window, axis=0).max()) <= settings.tip_box_mm:
            still[first : end + 1] = True
    runs = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        inside = gap_ends[(gap_ends > start) & (gap_ends < stop)]
        runs += np.split(np.arange(start, stop), inside - start)
    return [run for run in runs if len(run) > 1]


def _moving_mean(times: FloatArray, values: FloatArray, window_s: float) -> FloatArray:
    """The mean of the samples within half a window of each time."""
    sums = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values - values[0], axis=0)])
    first = np.searchsorted(times, times - 0.5 * window_s, side="left")
    end = np.searchsorted(times, times + 0.5 * window_s, side="right")
    return np.asarray((sums[end] - sums[first]) / (end - first)[:, None] + values[0])


def _largest_turn(rotations: FloatArray) -> float:
    """Largest angle in rad between two of the rotations; of 100 spread over a long stretch."""
    kept = rotations[np.unique(np.linspace(0, len(rotations) - 1, 100).round().astype(int))]
    traces = np.einsum("aij,bij->ab", kept, kept)
    return float(np.arccos(np.clip(0.5 * (traces.min() - 1.0), -1.0, 1.0)))
