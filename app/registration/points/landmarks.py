"""Matching of dwells of a stylus to landmarks of a phantom, in unknown order.

Each assignment of three dwells to three landmarks with the same mutual distances gives a rigid
motion. The motion that maps the largest number of dwells to landmarks is selected. If another
assignment of that size fits as well, the match is ambiguous and not accepted.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from app.geometry import FloatArray, TrackedTransform
from app.registration.errors import RegistrationError, ShapeError, TooFewError
from app.registration.inputs import MIN_POINTS, as_point, as_points, check_spread
from app.registration.points.dwells import Dwell, DwellSettings, detect_dwells
from app.registration.points.rigid_fit import fit_rigid

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

    @property
    def accepted(self) -> bool:
        """True if the match is unambiguous and may be used for a registration."""
        return self.match.accepted

    @property
    def reason(self) -> str:
        """One line that explains `accepted`."""
        return self.match.reason


def detect_landmarks(
    reference_from_tip: Sequence[TrackedTransform],
    landmarks_mm: Mapping[str, ArrayLike],
    *,
    tolerance_mm: float = 2.0,
    settings: DwellSettings | None = None,
) -> LandmarkDetection:
    """Detect the dwells of a stylus tip and match them to landmarks (3,) in mm, given by name.

    Raises the errors of `detect_dwells` and `match_landmarks`.
    """
    dwells = detect_dwells(reference_from_tip, settings)
    if len(dwells) < MIN_POINTS:
        raise TooFewError(
            f"{len(dwells)} dwells in {len(reference_from_tip)} samples"
            f"{_still_rests(reference_from_tip, settings or DwellSettings())}; "
            f"expected at least {MIN_POINTS}"
        )
    positions = np.stack([dwell.position_mm for dwell in dwells])
    return LandmarkDetection(
        dwells, match_landmarks(positions, landmarks_mm, tolerance_mm=tolerance_mm)
    )


def _still_rests(samples: Sequence[TrackedTransform], settings: DwellSettings) -> str:
    """Part of a message on rests in which the shaft did not turn; empty without any."""
    rests = detect_dwells(samples, replace(settings, min_turn_rad=0.0))
    still = [rest.turn_rad for rest in rests if rest.turn_rad < settings.min_turn_rad]
    if not still:
        return ""
    return (
        f" (the tip rested at {len(still)} more places, where the shaft turned by at most "
        f"{math.degrees(max(still)):.3g} degrees; a dwell needs "
        f"{math.degrees(settings.min_turn_rad):.3g})"
    )


def match_landmarks(
    dwells_mm: ArrayLike, landmarks_mm: Mapping[str, ArrayLike], *, tolerance_mm: float
) -> LandmarkMatch:
    """Assign dwells (m, 3) to landmarks (3,) in mm, in any order, each at most once.

    The distance of a pair after the best fit is at most ``tolerance_mm``. Not accepted if fewer
    than three pairs or fewer than half of the dwells are assigned, or if two assignments of that
    size fit within the tolerance; the reason then lists both.
    """
    if not (math.isfinite(tolerance_mm) and tolerance_mm > 0.0):
        raise ShapeError(f"tolerance_mm is {tolerance_mm}; expected a finite number above 0")
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
