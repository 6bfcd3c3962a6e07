"""True breaches: exact times at which a motion without noise enters and leaves the tumour."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from app.geometry import FloatArray, Transform
from app.synthetic.clearance import Clearance
from app.synthetic.poses import Poses

TRAVEL_STEP_S = 0.02
TRAVEL_SAFETY = 2.0
"""The travel of the tool is summed over chords of `TRAVEL_STEP_S` and multiplied by this."""

MIN_STEP_S = 0.0005
"""Minimum step: a shorter contact may be missed."""

DEPTH_STEP_S = 0.005

_DISTANCE_ERROR_MM = 0.05
"""Error of two distances by `Clearance`, which samples both surfaces."""

Motion = Callable[[float], Transform]
"""Maps a time in s from the first frame to ``tumor_from_tip``."""

PosesAt = Callable[[FloatArray], Poses]
"""Maps times (n,) in s from the first frame to n poses."""


@dataclass(frozen=True, slots=True)
class TrueBreach:
    """An interval in which the tool is in the tumour, and its minimum signed distance.

    ``tip_clearance_mm``: minimum signed distance of the tip alone, negative when it is inside.
    """

    start_s: float
    end_s: float
    min_signed_distance_mm: float
    tip_clearance_mm: float

    @property
    def shaft_only(self) -> bool:
        """True if the tip stays outside the tumour."""
        return self.tip_clearance_mm > 0.0


def find_breaches(
    clearance: Clearance,
    tumor_from_tip: Motion,
    duration_s: float,
    poses_at: PosesAt | None = None,
) -> tuple[TrueBreach, ...]:
    """Find every breach of a motion from 0 to ``duration_s``.

    ``poses_at`` are the poses of ``tumor_from_tip`` at many times at once, which takes less time.
    Steps by conservative advancement: at a distance ``d`` there is no contact before the tool has
    travelled ``d``. The sign of the height is exact, so a root finder gives each crossing. A breach
    at the start or end of the motion begins or ends there.
    """

    def height(time_s: float) -> float:
        return clearance.height_mm(tumor_from_tip(time_s))

    at_all = poses_at or (lambda times_s: Poses.of([tumor_from_tip(t) for t in times_s.tolist()]))
    times, travel_mm = _travel(at_all, duration_s, clearance.tool_length_mm)
    crossings: list[float] = []
    time_s, here = 0.0, height(0.0)
    if here < 0.0:
        crossings.append(0.0)
    while time_s < duration_s:
        safe_mm = clearance.distance_per_height * abs(here) / TRAVEL_SAFETY
        reach_mm = float(np.interp(time_s, times, travel_mm)) + safe_mm
        safe_until_s = float(times[np.searchsorted(travel_mm, reach_mm, side="right") - 1])
        later_s = min(max(safe_until_s, time_s + MIN_STEP_S), duration_s)
        later = height(later_s)
        if (later < 0.0) != (here < 0.0):
            crossings.append(float(brentq(height, time_s, later_s, xtol=1e-7)))
        time_s, here = later_s, later
    if here < 0.0:
        crossings.append(duration_s)
    return tuple(
        _measure(clearance, tumor_from_tip, at_all, start_s, end_s)
        for start_s, end_s in zip(crossings[::2], crossings[1::2], strict=True)
    )


def _travel(
    poses_at: PosesAt, duration_s: float, length_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Times (n,), and the travel (n,) of the tool up to then."""
    times = np.linspace(0.0, duration_s, int(np.ceil(duration_s / TRAVEL_STEP_S)) + 1)
    return times, _travelled(poses_at(times), length_mm)


def _travelled(poses: Poses, length_mm: float) -> FloatArray:
    """The travel (n,) up to each pose of that end of the tool which moves more.

    Points of the axis between the ends travel no farther; the safety factor covers the others, a
    few mm off the axis.
    """
    positions = poses.apply(np.array([(0.0, 0.0, 0.0), (0.0, 0.0, -length_mm)]))
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2).max(axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _measure(
    clearance: Clearance,
    tumor_from_tip: Motion,
    poses_at: PosesAt,
    start_s: float,
    end_s: float,
) -> TrueBreach:
    count = max(3, int(np.ceil((end_s - start_s) / DEPTH_STEP_S)) + 1)
    times = np.linspace(start_s, end_s, count)
    poses = poses_at(times)
    deepest, depth_mm = _deepest(clearance, poses)
    low, high = times[max(deepest - 1, 0)], times[min(deepest + 1, count - 1)]
    refined = minimize_scalar(
        lambda t: clearance.distance_mm(tumor_from_tip(t)), bounds=(low, high), method="bounded"
    )
    return TrueBreach(
        start_s,
        end_s,
        min(float(refined.fun), depth_mm),
        float(clearance.point_distances_mm(poses.translations_mm).min()),
    )


def _deepest(clearance: Clearance, all_poses: Poses) -> tuple[int, float]:
    """The first pose with the lowest distance, and that distance.

    Intervals are halved. Between two poses the distance is no lower than the mean of both minus
    half of the travel, so that an interval above the lowest distance is left out.
    """
    reach_mm = TRAVEL_SAFETY * _travelled(all_poses, clearance.tool_length_mm)
    poses = all_poses.transforms()
    found = {end: clearance.distance_mm(poses[end]) for end in (0, len(poses) - 1)}
    best, intervals = min(found.values()), [(0, len(poses) - 1)]
    while intervals:
        first, last = intervals.pop()
        bound = 0.5 * (found[first] + found[last] - float(reach_mm[last] - reach_mm[first]))
        if last - first > 1 and bound <= best + _DISTANCE_ERROR_MM:
            middle = (first + last) // 2
            found[middle] = clearance.distance_mm(poses[middle])
            best = min(best, found[middle])
            intervals += [(middle, last), (first, middle)]
    return min((number for number, depth in found.items() if depth == best)), best
