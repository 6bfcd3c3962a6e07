"""Which of many observations agree on one answer: least median of squares, then refits.

The start is the fit of a few observations that explains half of all of them best (Rousseeuw 1984),
drawn with a fixed seed, so that the same observations give the same answer. From there on the
observations that the current fit foretells make the next one, until they stay.
"""

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.registration.errors import NoConsensusError
from app.registration.quantiles import chi_square_quantile, f_quantile

State = TypeVar("State")

WRONG_RATE = 0.01
"""How often, at most, a good observation of a whole clean set may be called wrong."""

_ROUNDING = 1e-9

MAX_DRAWS = 100
MAX_REFITS = 30


def agreeing(
    count: int,
    what: str,
    *,
    draw: int,
    noise_known: bool,
    start: Callable[[NDArray[np.bool_]], State],
    refine: Callable[[NDArray[np.bool_], State], State],
    linearise: Callable[[State], tuple[FloatArray, FloatArray]],
) -> tuple[NDArray[np.bool_], State]:
    """The mask (count,) of observations that agree, and the refined state from them.

    ``start`` fits the observations of a mask roughly, ``refine`` well (and finds their noise, when
    it is not known). ``linearise`` gives the misfit of every observation in standard deviations
    (count, f) and how it answers to the parameters (count, f, p). With noise not known the scale of
    the misfits is taken from their median at first. Raises `NoConsensusError` unless more than half
    of the observations agree.
    """
    least = max(draw, count // 2 + 1)
    state = min(
        (start(mask) for mask in _draws(count, draw)),
        key=lambda candidate: float(np.median(_squared(linearise(candidate)[0]))),
    )
    misfits, _ = linearise(state)
    squared, freedom = _squared(misfits), misfits.shape[1]
    middle = float(np.median(squared))
    if not noise_known and middle > 0.0:
        squared = squared * (chi_square_quantile(0.5, freedom) / middle)
    # The start is rough, even where the noise is known: its better half is taken in any case.
    bound = chi_square_quantile(1.0 - WRONG_RATE / count, freedom)
    good = squared <= max(bound, float(np.sort(squared)[least - 1]))
    for _ in range(MAX_REFITS):
        try:
            state = refine(good, state)
            again = _agree(*linearise(state), good, noise_known=noise_known)
        except np.linalg.LinAlgError as error:
            raise NoConsensusError(
                f"the {what} that agree, {int(good.sum())} of {count}, leave part of the answer "
                f"free: {error}"
            ) from error
        if again.sum() < least:
            raise NoConsensusError(
                f"only {int(again.sum())} of {count} {what} agree: at least {least} wanted"
            )
        if np.array_equal(again, good):
            return good, state
        good = again
    raise NoConsensusError(f"which {what} agree did not settle in {MAX_REFITS} rounds")


def _agree(
    misfits: FloatArray, jacobian: FloatArray, good: NDArray[np.bool_], *, noise_known: bool
) -> NDArray[np.bool_]:
    """Which observations a fit of the ``good`` ones, each left out in its turn, foretells.

    By their plain misfits a small group would be sure of itself: an observation that is in the fit
    draws it near, and to one that is not the fit's own error is added. Both are allowed for
    (deleted residuals; Cook and Weisberg, Residuals and Influence in Regression, 1982, section
    2.2), and that the noise was found from few observations, of which this may be one.
    """
    count, freedom, parameters = jacobian.shape
    used = jacobian[good].reshape(-1, parameters)
    drawn = jacobian @ np.linalg.inv(used.T @ used) @ np.swapaxes(jacobian, 1, 2)
    sign = np.where(good, -1.0, 1.0)[:, None, None]
    # One that alone determines a parameter is fitted whatever it is: nothing is known against it.
    spread = (1.0 + _ROUNDING) * np.eye(freedom) + sign * drawn
    squared = np.einsum("ni,ni->n", misfits, np.linalg.solve(spread, misfits[..., None])[..., 0])
    right = 1.0 - WRONG_RATE / count
    if noise_known:
        return np.asarray(squared <= chi_square_quantile(right, freedom))
    left = freedom * int(good.sum()) - parameters
    others = left - freedom
    if others <= 0:
        return good
    without = squared * others / np.maximum(left - squared, _ROUNDING)
    bounds = [freedom * f_quantile(right, freedom, among) for among in (others, left)]
    return np.asarray(np.where(good, without <= bounds[0], squared <= bounds[1]))


def _squared(misfits: FloatArray) -> FloatArray:
    return np.asarray(np.sum(misfits**2, axis=1))


def _draws(count: int, draw: int) -> list[NDArray[np.bool_]]:
    generator = np.random.default_rng(0)
    masks = [np.ones(count, dtype=bool)]
    possible = math.comb(count, draw) if count > draw else 0
    for _ in range(min(MAX_DRAWS, 3 * possible)):
        mask = np.zeros(count, dtype=bool)
        mask[generator.choice(count, draw, replace=False)] = True
        masks.append(mask)
    return masks
