"""Detection of dwells of a tracked stylus: the tip is at rest while the shaft rotates about it.

A landmark is marked in this way, as in PLUS. A stylus at rest that does not rotate is not a dwell:
it may lie on a table. The position is averaged over the first ``dwell_s`` after the tip came to
rest, as in a live capture: later samples are more tilted, and the error of the tip calibration
grows with the tilt.
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
    """Criteria of a dwell.

    ``window_s``
        Length of the moving average of the tip position.
    ``dwell_s``, ``tip_box_mm``
        The averaged tip stays in a box of this size for at least this time.
    ``min_turn_rad``
        The stylus rotates by at least this angle meanwhile: 0.3 rad move a point 100 mm up the
        shaft by 30 mm. 0 for a tool that does not rotate.
    ``spacing_mm``
        A dwell closer than this to an earlier one is on the same landmark and is ignored.
    ``max_gap_s``
        Successive samples of a dwell are at most this far apart.
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
                raise ShapeError(
                    f"{field.name} of a dwell is {value}; expected a finite number, 0 or more"
                )
        if self.window_s > self.dwell_s:
            raise ShapeError(
                f"window_s is {self.window_s}, longer than dwell_s; expected at most {self.dwell_s}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Dwell:
    """Position (3,) of the tip in mm in the samples' target frame, the mean of ``count`` samples.

    ``spread_mm`` is their RMS distance from the mean. ``start``, ``end`` and the largest rotation
    ``turn_rad`` of the stylus belong to the whole period in which the tip was at rest.
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
    """Return the dwells in a recording of a stylus tip, in time order.

    Samples that are not OK are ignored. Raises `NoValidSamplesError` if none is OK, `FrameError`
    for samples between different frames and `ShapeError` for decreasing times.
    """
    settings = settings or DwellSettings()
    poses = usable_poses(reference_from_tip)
    names = {(pose.target, pose.source) for pose in poses}
    if len(names) > 1:
        raise FrameError(
            f"samples of a stylus have different frames: {sorted(names)}; expected the same frames"
        )
    stamps = [sample.stamp for sample in reference_from_tip if sample.transform is not None]
    times = np.array([stamp.ns - stamps[0].ns for stamp in stamps]) / NS_PER_S
    if np.any(np.diff(times) < 0.0):
        late = int(np.argmin(np.diff(times))) + 1
        raise ShapeError(
            f"valid sample {late} of a stylus goes back in time; expected increasing times"
        )
    tips = np.stack([pose.translation_mm for pose in poses])
    rotations = np.stack([pose.rotation for pose in poses])

    dwells: list[Dwell] = []
    for run in _rest_runs(times, tips, settings):
        turn = _largest_rotation(rotations[run])
        # At the start of a run the moving average includes samples of the approach.
        since_rest = times[run] - times[run[0]] - 0.5 * settings.window_s
        averaged = tips[run[(since_rest >= 0.0) & (since_rest <= settings.dwell_s)]]
        position = averaged.mean(axis=0)
        visited = any(
            np.linalg.norm(dwell.position_mm - position) < settings.spacing_mm for dwell in dwells
        )
        if turn < settings.min_turn_rad or visited:
            continue
        dwells.append(
            Dwell(
                position_mm=position,
                start=stamps[run[0]],
                end=stamps[run[-1]],
                count=len(averaged),
                spread_mm=float(np.sqrt(np.sum(np.var(averaged, axis=0)))),
                turn_rad=turn,
            )
        )
    return tuple(dwells)


def _rest_runs(
    times: FloatArray, tips: FloatArray, settings: DwellSettings
) -> list[NDArray[np.intp]]:
    """Return the sample indices of each period in which the tip is at rest."""
    smooth = _moving_mean(times, tips, settings.window_s)
    last = np.searchsorted(times, times + settings.dwell_s, side="left")
    still = np.zeros(len(times), dtype=bool)
    # The tip may have moved in a gap between samples.
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
    """Mean of the samples within half a window of each time."""
    sums = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values - values[0], axis=0)])
    first = np.searchsorted(times, times - 0.5 * window_s, side="left")
    end = np.searchsorted(times, times + 0.5 * window_s, side="right")
    return np.asarray((sums[end] - sums[first]) / (end - first)[:, None] + values[0])


def _largest_rotation(rotations: FloatArray) -> float:
    """Largest angle in rad between two of the rotations (n, 3, 3); compares at most 100 of them."""
    compared = rotations[np.unique(np.linspace(0, len(rotations) - 1, 100).round().astype(int))]
    traces = np.einsum("aij,bij->ab", compared, compared)
    return float(np.arccos(np.clip(0.5 * (traces.min() - 1.0), -1.0, 1.0)))
