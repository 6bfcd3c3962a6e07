"""Which of many observations agree on one answer: least median of squares, then refits.

The start is the fit of a few observations that explains half of all of them best (Rousseeuw 1984),
drawn with a fixed seed, so that the same observations give the same answer. From there on the
observations within a chi-square bound of the current fit make the next one, until they stay.
"""

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.registration.errors import NoConsensusError
from app.registration.quantiles import chi_square_quantile

State = TypeVar("State")

WRONG_RATE = 0.01
"""How often, at most, a good observation of a whole clean set may be called wrong."""

MAX_DRAWS = 100
MAX_REFITS = 30


def agreeing(
    count: int,
    what: str,
    *,
    draw: int,
    freedom: int,
    noise_known: bool,
    start: Callable[[NDArray[np.bool_]], State],
    refine: Callable[[NDArray[np.bool_], State], State],
    squared_sigmas: Callable[[State], FloatArray],
) -> tuple[NDArray[np.bool_], State]:
    """The mask (count,) of observations that agree, and the refined state from them.

    ``start`` fits the observations of a mask roughly, ``refine`` well (and finds their noise, when
    it is not known). ``squared_sigmas`` (count,) is each misfit in squared standard deviations,
    ``freedom`` numbers each; with noise not known their scale is taken from their median at first.
    Raises `NoConsensusError` unless more than half of the observations agree.
    """
    bound = chi_square_quantile(1.0 - WRONG_RATE / count, freedom)
    least = max(draw, count // 2 + 1)
    state = min(
        (start(mask) for mask in _draws(count, draw)),
        key=lambda candidate: float(np.median(squared_sigmas(candidate))),
    )
    squared = squared_sigmas(state)
    middle = float(np.median(squared))
    if not noise_known and middle > 0.0:
        squared = squared * (chi_square_quantile(0.5, freedom) / middle)
    # The start is rough, even where the noise is known: its better half is taken in any case.
    good = squared <= max(bound, float(np.median(squared)))
    for _ in range(MAX_REFITS):
        state = refine(good, state)
        again = squared_sigmas(state) <= bound
        if again.sum() < least:
            raise NoConsensusError(
                f"only {int(again.sum())} of {count} {what} agree: at least {least} wanted"
            )
        if np.array_equal(again, good):
            return good, state
        good = again
    raise NoConsensusError(f"which {what} agree did not settle in {MAX_REFITS} rounds")


def _draws(count: int, draw: int) -> list[NDArray[np.bool_]]:
    generator = np.random.default_rng(0)
    masks = [np.ones(count, dtype=bool)]
    possible = math.comb(count, draw) if count > draw else 0
    for _ in range(min(MAX_DRAWS, 3 * possible)):
        mask = np.zeros(count, dtype=bool)
        mask[generator.choice(count, draw, replace=False)] = True
        masks.append(mask)
    return masks
