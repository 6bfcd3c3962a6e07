"""Dwells of a tracked stylus, and their matching to landmarks of a phantom in unknown order.

In a dwell the tip is at rest while the shaft rotates about it: a landmark is marked in this way, as
in PLUS. A stylus at rest that does not rotate is not a dwell: it may lie on a table. The position
is averaged over the first ``dwell_s`` after the tip came to rest, as in a live capture: later
samples are more tilted, and the error of the tip calibration grows with the tilt.

Each assignment of three dwells to three landmarks with the same mutual distances gives a rigid
motion. The motion that maps the largest number of dwells to landmarks is selected. If another
assignment of that size fits as well, the match is ambiguous and not accepted.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from app.geometry import NS_PER_S, FloatArray, FrameError, Stamp, TrackedTransform
from app.registration.input_checks import (
    MIN_POINTS,
    RegistrationError,
    ShapeError,
    TooFewError,
    as_point,
    as_points,
    check_positive,
    check_spread,
)
from app.registration.paired_points import fit_rigid
from app.registration.pose_stack import usable_poses
from app.registration.registration_result import read_only


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


TOLERANCE_MM = 2.0
"""Largest distance of a dwell of `detect_landmarks` from its landmark."""

MAX_DWELL_TRIPLES = 60
"""Maximum number of triples of dwells that are tried, the largest triangles first."""

Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class LandmarkMatch:
    """Assignment of dwells to landmarks.

    ``pairs`` of (dwell index, landmark name) are empty unless ``accepted``. ``rms_mm`` is the
    misfit of the pairs, NaN without pairs. ``unmatched_dwells`` are on no landmark, ``missing``
    landmarks have no dwell. ``reason`` explains the result in either case.
    """

    pairs: tuple[tuple[int, str], ...]
    unmatched_dwells: tuple[int, ...]
    missing: tuple[str, ...]
    rms_mm: float
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkDetection:
    """The dwells of a recording and their assignment to landmarks."""

    dwells: tuple[Dwell, ...]
    match: LandmarkMatch


def detect_landmarks(
    reference_from_tip: Sequence[TrackedTransform], landmarks_mm: Mapping[str, ArrayLike]
) -> LandmarkDetection:
    """Detect the dwells of a stylus tip and match them to landmarks (3,) in mm, given by name.

    The match is that of `match_landmarks` within `TOLERANCE_MM`.
    Raises the errors of `detect_dwells` and `match_landmarks`.
    """
    dwells = detect_dwells(reference_from_tip)
    if len(dwells) < MIN_POINTS:
        raise TooFewError(
            f"{len(dwells)} dwells in {len(reference_from_tip)} samples"
            f"{_still_rests(reference_from_tip)}; expected at least {MIN_POINTS}"
        )
    positions = np.stack([dwell.position_mm for dwell in dwells])
    return LandmarkDetection(
        dwells, match_landmarks(positions, landmarks_mm, tolerance_mm=TOLERANCE_MM)
    )


def _still_rests(samples: Sequence[TrackedTransform]) -> str:
    """Part of a message on rests in which the shaft did not turn; empty without any."""
    needed_rad = DwellSettings().min_turn_rad
    rests = detect_dwells(samples, DwellSettings(min_turn_rad=0.0))
    still = [rest.turn_rad for rest in rests if rest.turn_rad < needed_rad]
    if not still:
        return ""
    return (
        f" (the tip rested at {len(still)} more places, where the shaft turned by at most "
        f"{math.degrees(max(still)):.3g} degrees; a dwell needs "
        f"{math.degrees(needed_rad):.3g})"
    )


def match_landmarks(
    dwells_mm: ArrayLike, landmarks_mm: Mapping[str, ArrayLike], *, tolerance_mm: float
) -> LandmarkMatch:
    """Assign dwells (m, 3) to landmarks (3,) in mm, in any order, each at most once.

    The distance of a pair after the best fit is at most ``tolerance_mm``. Not accepted if fewer
    than three pairs or fewer than half of the dwells are assigned, or if two assignments of that
    size fit within the tolerance; the reason then lists both.
    """
    check_positive(tolerance_mm, "tolerance_mm")
    names = tuple(landmarks_mm)
    dwells = as_points(dwells_mm, "dwells_mm")
    landmarks = np.vstack(
        [as_point(landmarks_mm[name], f"landmark {name!r}") for name in names] or [np.empty((0, 3))]
    )
    for what, points in (("dwells", dwells), ("landmarks", landmarks)):
        if len(points) < MIN_POINTS:
            raise TooFewError(f"{len(points)} {what}; expected at least {MIN_POINTS}")
        check_spread(points, what)
    assignments = _find_assignments(dwells, landmarks, tolerance_mm)
    min_size = max(MIN_POINTS, (len(dwells) + 1) // 2)
    size = max((len(pairs) for pairs in assignments), default=0)
    best = sorted((rms, pairs) for pairs, rms in assignments.items() if len(pairs) == size)
    if size < min_size:
        return _no_match(
            dwells,
            names,
            f"{size} of {len(dwells)} dwells fit on landmarks within {tolerance_mm:g} mm; "
            f"expected at least {min_size}",
        )
    rms, pairs = best[0]
    if len(best) > 1:
        examples = " or ".join(_format_pairs(pairs, names) for _, pairs in best[:2])
        return _no_match(
            dwells,
            names,
            f"ambiguous: {len(best)} assignments of {size} dwells to landmarks fit within "
            f"{tolerance_mm:g} mm: {examples}; expected 1",
        )
    missing = set(range(len(names))) - {landmark for _, landmark in pairs}
    return LandmarkMatch(
        pairs=tuple((dwell, names[landmark]) for dwell, landmark in pairs),
        unmatched_dwells=tuple(sorted(set(range(len(dwells))) - {dwell for dwell, _ in pairs})),
        missing=tuple(names[landmark] for landmark in sorted(missing)),
        rms_mm=rms,
        accepted=True,
        reason=f"{size} of {len(dwells)} dwells on {size} of {len(names)} landmarks, "
        f"{rms:.3g} mm RMS, no other assignment within {tolerance_mm:g} mm",
    )


def _no_match(dwells: FloatArray, names: tuple[str, ...], reason: str) -> LandmarkMatch:
    return LandmarkMatch((), tuple(range(len(dwells))), names, math.nan, False, reason)


def _format_pairs(pairs: Pairs, names: tuple[str, ...]) -> str:
    return " ".join(f"{dwell}={names[landmark]}" for dwell, landmark in pairs)


def _find_assignments(
    dwells: FloatArray, landmarks: FloatArray, tolerance_mm: float
) -> dict[Pairs, float]:
    """Return all assignments that start from a triple of dwells, with their RMS in mm."""
    triples = np.array(list(permutations(range(len(landmarks)), 3)), dtype=np.intp)
    sides = _sides(landmarks[triples])
    assignments: dict[Pairs, float] = {}
    for triple in _largest_triples(dwells):
        misfit = np.abs(sides - _sides(dwells[triple][None])).max(axis=1)
        for corners in triples[misfit <= 2.0 * tolerance_mm]:
            grown = _grow(dwells, landmarks, triple, corners, tolerance_mm)
            if grown is not None:
                assignments[grown[0]] = grown[1]
    return assignments


def _largest_triples(points: FloatArray) -> NDArray[np.intp]:
    triples = np.array(list(combinations(range(len(points)), 3)), dtype=np.intp)
    first, second, third = np.moveaxis(points[triples], 1, 0)
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    return np.asarray(triples[np.argsort(-areas, kind="stable")[:MAX_DWELL_TRIPLES]])


def _sides(triangles: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2))


def _grow(
    dwells: FloatArray,
    landmarks: FloatArray,
    triple: NDArray[np.intp],
    corners: NDArray[np.intp],
    tolerance_mm: float,
) -> tuple[Pairs, float] | None:
    """Extend three pairs by all that fit and refit until they stay the same.

    Returns the pairs and their RMS in mm, or None without convergence to at least three pairs.
    """
    pairs: Pairs = tuple(zip(triple.tolist(), corners.tolist(), strict=True))
    for _ in range(10):
        rows, columns = (np.array(side) for side in zip(*pairs, strict=True))
        try:
            check_spread(dwells[rows], "dwells")
            motion = fit_rigid(landmarks[columns], dwells[rows], None, "landmarks", "dwells")
        except RegistrationError:
            return None  # collinear or mirrored: no rigid motion maps these pairs
        gaps = np.linalg.norm(motion.apply(dwells)[:, None] - landmarks[None], axis=2)
        chosen = linear_sum_assignment(np.minimum(gaps, tolerance_mm))
        new_pairs = tuple(
            (int(row), int(column))
            for row, column in zip(*chosen, strict=True)
            if gaps[row, column] < tolerance_mm
        )
        if len(new_pairs) < MIN_POINTS:
            return None
        if new_pairs == pairs:
            return pairs, float(np.sqrt(np.mean(gaps[tuple(np.array(pairs).T)] ** 2)))
        pairs = new_pairs
    return None
