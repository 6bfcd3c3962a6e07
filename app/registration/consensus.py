"""Robust estimation: least median of squares, then refits to the inliers.

The initial fit is that of a small random subset with the smallest median of squared residuals over
all observations (Rousseeuw 1984). Subsets are drawn with a fixed seed, so results are reproducible.
The fit is then repeated with the observations that are consistent with it until they stay the
same. Quantiles are computed without `scipy.stats`, which would double the start-up time.
"""

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.registration.input_checks import NoConsensusError

# Every start of a session needs one of the chi-square distribution. For it alone `scipy.special`,
# which takes 0.15 s to load, is not needed either: the distribution has a closed form.


def chi_square_quantile(probability: float, freedom: int) -> float:
    """Quantile of the chi-square distribution with ``freedom`` degrees of freedom.

    The probability to exceed ``2 h`` is the sum of ``exp(-h) h^i / Gamma(i + 1)`` over i = 0, 1,
    ... below half the freedom, or over 1/2, 3/2, ... with ``erfc(sqrt(h))`` if the freedom is odd
    (Abramowitz and Stegun, 26.4.4 and 26.4.5). It is solved for ``h`` by bisection.
    """
    powers = np.arange(0.5 * (freedom % 2), 0.5 * freedom)
    log_gammas = np.array([math.lgamma(power + 1.0) for power in powers.tolist()])

    def exceeds(half: float) -> bool:
        above = float(np.exp(powers * math.log(half) - half - log_gammas).sum())
        above += math.erfc(math.sqrt(half)) if freedom % 2 else 0.0
        return 1.0 - above > probability

    low, high = 0.0, float(freedom)
    while not exceeds(high):
        low, high = high, 2.0 * high
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (low, middle) if exceeds(middle) else (middle, high)
    return low + high


def f_quantile(probability: float, numerator: int, denominator: int) -> float:
    """Quantile of the F distribution with these degrees of freedom."""
    from scipy.special import fdtri

    return float(fdtri(numerator, denominator, probability))


def student_quantile(probability: float, freedom: int) -> float:
    """Quantile of Student's t distribution with ``freedom`` degrees of freedom."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, probability))


State = TypeVar("State")

FALSE_REJECTION_RATE = 0.01
"""Probability that an observation set without outliers loses an observation."""

_ROUNDING = 1e-9

MAX_SAMPLES = 100
MAX_REFITS = 30
MAX_UNDECIDED_SHARE = 0.1
"""Largest share of observations at the bound that may be left out to end a cycle of refits."""


def find_consensus(
    count: int,
    what: str,
    *,
    sample_size: int,
    noise_known: bool,
    initialise: Callable[[NDArray[np.bool_]], State],
    refine: Callable[[NDArray[np.bool_], State], State],
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
) -> tuple[NDArray[np.bool_], State]:
    """Return the mask (count,) of inliers and the state refined from them.

    ``initialise`` computes a rough fit from the observations of a mask, ``refine`` a good one
    (with an estimate of the noise if it is not known). ``linearise`` returns the residuals of all
    observations in standard deviations (count, f) and their Jacobian (count, f, p).
    ``sample_size`` is the number of observations of an initial fit. If the noise is not known, the
    scale of the first residuals is taken from their median. ``what`` names the observations.
    Raises `NoConsensusError` unless more than half of the observations agree.
    """
    min_inliers = max(sample_size, count // 2 + 1)
    state = min(
        (initialise(mask) for mask in _sample_masks(count, sample_size)),
        key=lambda candidate: float(np.median(_squared(linearise(candidate)[0]))),
    )
    residuals, _ = linearise(state)
    squared, freedom = _squared(residuals), residuals.shape[1]
    median = float(np.median(squared))
    if not noise_known and median > 0.0:
        squared = squared * (chi_square_quantile(0.5, freedom) / median)
    # The initial fit is rough: its better half is used even if all exceed the bound.
    bound = chi_square_quantile(1.0 - FALSE_REJECTION_RATE / count, freedom)
    inliers = squared <= max(bound, float(np.sort(squared)[min_inliers - 1]))
    earlier: list[NDArray[np.bool_]] = []
    for _ in range(MAX_REFITS):
        try:
            state = refine(inliers, state)
            consistent = _consistent_with_fit(*linearise(state), inliers, noise_known=noise_known)
        except np.linalg.LinAlgError as error:
            raise NoConsensusError(
                f"the {what} that agree ({int(inliers.sum())} of {count}) leave part of the result "
                f"undetermined: {error}"
            ) from error
        if consistent.sum() < min_inliers:
            raise NoConsensusError(
                f"only {int(consistent.sum())} of {count} {what} agree; "
                f"expected at least {min_inliers}"
            )
        if np.array_equal(consistent, inliers):
            return inliers, state
        earlier.append(inliers)
        repeated = [index for index, mask in enumerate(earlier) if np.array_equal(mask, consistent)]
        if repeated:
            inliers = _common(np.array(earlier[repeated[0] :]), what, min_inliers)
            return inliers, refine(inliers, state)
        inliers = consistent
    raise NoConsensusError(
        f"which {what} agree changes with each of {MAX_REFITS} refits, between "
        f"{min(map(np.sum, earlier))} and {max(map(np.sum, earlier))} of {count}; expected a "
        "majority that fits one result"
    )


def _common(cycle: NDArray[np.bool_], what: str, min_inliers: int) -> NDArray[np.bool_]:
    """Resolve a cycle (k, count) of refits: observations at the bound are in only some of them.

    Those are left out. Raises `NoConsensusError` if they are many: then no result is favoured.
    """
    common = np.asarray(np.all(cycle, axis=0))
    undecided = int(np.any(cycle, axis=0).sum() - common.sum())
    if common.sum() < min_inliers or undecided > MAX_UNDECIDED_SHARE * len(common):
        raise NoConsensusError(
            f"{undecided} of {len(common)} {what} agree in one refit and not in the next; "
            f"expected a majority that fits one result, with {MAX_UNDECIDED_SHARE:.0%} undecided "
            "at most"
        )
    return common


def _consistent_with_fit(
    residuals: FloatArray, jacobian: FloatArray, inliers: NDArray[np.bool_], *, noise_known: bool
) -> NDArray[np.bool_]:
    """Return the mask of observations that are consistent with a fit to the other ``inliers``.

    Plain residuals would favour a small group: an observation in the fit pulls the fit towards it,
    and one outside has the error of the fit added. Deleted residuals account for both (Cook and
    Weisberg, Residuals and Influence in Regression, 1982, section 2.2). The bound accounts for
    noise that was estimated from few observations, including the tested one.
    """
    count, freedom, parameters = jacobian.shape
    used = jacobian[inliers].reshape(-1, parameters)
    hat = jacobian @ np.linalg.inv(used.T @ used) @ np.swapaxes(jacobian, 1, 2)
    sign = np.where(inliers, -1.0, 1.0)[:, None, None]
    # The margin keeps this regular for an observation that alone determines a parameter.
    spread = (1.0 + _ROUNDING) * np.eye(freedom) + sign * hat
    squared = np.einsum(
        "ni,ni->n", residuals, np.linalg.solve(spread, residuals[..., None])[..., 0]
    )
    confidence = 1.0 - FALSE_REJECTION_RATE / count
    if noise_known:
        return np.asarray(squared <= chi_square_quantile(confidence, freedom))
    total_freedom = freedom * int(inliers.sum()) - parameters
    other_freedom = total_freedom - freedom
    if other_freedom <= 0:
        return inliers
    deleted = squared * other_freedom / np.maximum(total_freedom - squared, _ROUNDING)
    inside, outside = (
        freedom * f_quantile(confidence, freedom, denominator)
        for denominator in (other_freedom, total_freedom)
    )
    return np.asarray(np.where(inliers, deleted <= inside, squared <= outside))


def _squared(residuals: FloatArray) -> FloatArray:
    return np.asarray(np.sum(residuals**2, axis=1))


def _sample_masks(count: int, sample_size: int) -> list[NDArray[np.bool_]]:
    generator = np.random.default_rng(0)
    masks = [np.ones(count, dtype=bool)]
    possible = math.comb(count, sample_size) if count > sample_size else 0
    for _ in range(min(MAX_SAMPLES, 3 * possible)):
        mask = np.zeros(count, dtype=bool)
        mask[generator.choice(count, sample_size, replace=False)] = True
        masks.append(mask)
    return masks
