"""Which dwell of a stylus was on which landmark of a phantom, the order not being known.

Every way to lay three dwells on three landmarks that have the same distances gives a motion; the
motion that lays most dwells on landmarks wins. When another way fits as well, nobody can say which
is right, and this does not guess.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
"""How many triples of dwells, the largest triangles first, are laid on the landmarks."""

Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class LandmarkMatch:
    """``pairs`` of (dwell, landmark name); empty unless ``accepted``.

    ``rms_mm`` is the misfit of the pairs, NaN without any. ``unmatched_dwells`` are on no landmark,
    ``missing`` landmarks have no dwell. ``reason`` says what was found, or why nothing is claimed.
    """

    pairs: tuple[tuple[int, str], ...]
    unmatched_dwells: tuple[int, ...]
    missing: tuple[str, ...]
    rms_mm: float
    accepted: bool
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkDetection:
    """The dwells of a recording, and which landmarks they were on."""

    dwells: tuple[Dwell, ...]
    match: LandmarkMatch

    @property
    def accepted(self) -> bool:
        """Whether the match may be registered by."""
        return self.match.accepted

    @property
    def reason(self) -> str:
        """Why, or why not."""
        return self.match.reason


def detect_landmarks(
    reference_from_tip: Sequence[TrackedTransform],
    landmarks_mm: Mapping[str, ArrayLike],
    *,
    tolerance_mm: float = 2.0,
    settings: DwellSettings | None = None,
) -> LandmarkDetection:
    """The dwells of a stylus tip in a recording, matched to landmarks (3,) by name.

    See `detect_dwells` and `match_landmarks`, whose errors it raises.
    """
    dwells = detect_dwells(reference_from_tip, settings)
    if len(dwells) < MIN_POINTS:
        raise TooFewError(
            f"{len(dwells)} dwells in {len(reference_from_tip)} samples: "
            f"at least {MIN_POINTS} wanted"
        )
    positions = np.stack([dwell.position_mm for dwell in dwells])
    return LandmarkDetection(
        dwells, match_landmarks(positions, landmarks_mm, tolerance_mm=tolerance_mm)
    )


def match_landmarks(
    dwells_mm: ArrayLike, landmarks_mm: Mapping[str, ArrayLike], *, tolerance_mm: float
) -> LandmarkMatch:
    """Lay dwells (m, 3) on landmarks (3,) by name, in any order, each at most once.

    A pair may miss by ``tolerance_mm`` after the best fit. Not accepted when fewer than three
    pairs, or fewer than half of the dwells, are laid, and when two ways of the same size fit within
    the tolerance: both are then told.
    """
    if not (math.isfinite(tolerance_mm) and tolerance_mm > 0.0):
        raise ShapeError(f"tolerance_mm is {tolerance_mm}: above 0 wanted")
    names = tuple(landmarks_mm)
    dwells = as_points(dwells_mm, "dwells_mm")
    landmarks = np.vstack(
        [as_point(landmarks_mm[name], f"landmark {name!r}") for name in names] or [np.empty((0, 3))]
    )
    for what, points in (("dwells", dwells), ("landmarks", landmarks)):
        if len(points) < MIN_POINTS:
            raise TooFewError(f"{len(points)} {what}: at least {MIN_POINTS} wanted")
        check_spread(points, what)
    ways = _ways(dwells, landmarks, tolerance_mm)
    least = max(MIN_POINTS, (len(dwells) + 1) // 2)
    size = max((len(pairs) for pairs in ways), default=0)
    best = sorted((rms, pairs) for pairs, rms in ways.items() if len(pairs) == size)
    if size < least:
        return _nothing(
            dwells,
            names,
            f"{size} of {len(dwells)} dwells fit on landmarks within "
            f"{tolerance_mm:g} mm: at least {least} wanted",
        )
    rms, pairs = best[0]
    if len(best) > 1:
        told = " or ".join(_told(way, names) for _, way in best[:2])
        return _nothing(
            dwells,
            names,
            f"{len(best)} ways to lay {size} dwells on landmarks fit within "
            f"{tolerance_mm:g} mm: {told}",
        )
    missing = set(range(len(names))) - {landmark for _, landmark in pairs}
    return LandmarkMatch(
        pairs=tuple((dwell, names[landmark]) for dwell, landmark in pairs),
        unmatched_dwells=tuple(sorted(set(range(len(dwells))) - {dwell for dwell, _ in pairs})),
        missing=tuple(names[landmark] for landmark in sorted(missing)),
        rms_mm=rms,
        accepted=True,
        reason=f"{size} of {len(dwells)} dwells on {size} of {len(names)} landmarks, "
        f"{rms:.3g} mm RMS, no other way within {tolerance_mm:g} mm",
    )


def _nothing(dwells: FloatArray, names: tuple[str, ...], reason: str) -> LandmarkMatch:
    return LandmarkMatch((), tuple(range(len(dwells))), names, math.nan, False, reason)


def _told(pairs: Pairs, names: tuple[str, ...]) -> str:
    return " ".join(f"{dwell}={names[landmark]}" for dwell, landmark in pairs)


def _ways(dwells: FloatArray, landmarks: FloatArray, tolerance_mm: float) -> dict[Pairs, float]:
    """Every distinct way to lay dwells on landmarks that a triple leads to, with its RMS in mm."""
    laid = np.array(list(permutations(range(len(landmarks)), 3)), dtype=np.intp)
    laid_sides = _sides(landmarks[laid])
    ways: dict[Pairs, float] = {}
    for triple in _largest_triples(dwells):
        misfit = np.abs(laid_sides - _sides(dwells[triple][None])).max(axis=1)
        for corners in laid[misfit <= 2.0 * tolerance_mm]:
            found = _grow(dwells, landmarks, triple, corners, tolerance_mm)
            if found is not None:
                ways[found[0]] = found[1]
    return ways


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
    """Start from three pairs, add what fits, refit until it stays; None when it falls apart."""
    pairs: Pairs = tuple(zip(triple.tolist(), corners.tolist(), strict=True))
    for _ in range(10):
        rows, columns = (np.array(side) for side in zip(*pairs, strict=True))
        try:
            check_spread(dwells[rows], "dwells")
            motion = fit_rigid(landmarks[columns], dwells[rows], None, "landmarks", "dwells")
        except RegistrationError:
            return None  # a line or a mirror image: no motion lays these on each other
        gaps = np.linalg.norm(motion.apply(dwells)[:, None] - landmarks[None], axis=2)
        chosen = linear_sum_assignment(np.minimum(gaps, tolerance_mm))
        again = tuple(
            (int(row), int(column))
            for row, column in zip(*chosen, strict=True)
            if gaps[row, column] < tolerance_mm
        )
        if len(again) < MIN_POINTS:
            return None
        if again == pairs:
            return pairs, float(np.sqrt(np.mean(gaps[tuple(np.array(pairs).T)] ** 2)))
        pairs = again
    return None
