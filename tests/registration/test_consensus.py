"""Robust estimation: rejection of outliers by consensus."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.registration import NoConsensusError
from app.registration.consensus import FALSE_REJECTION_RATE, _consistent_with_fit, find_consensus
from tests.oracles.registration_consensus import consistent_by_refits


def robust_mean(values, sigma):
    """Robust mean of ``values``; estimates their noise if ``sigma`` is None."""

    def refine(mask: NDArray[np.bool_], _: tuple[float, float]) -> tuple[float, float]:
        return float(values[mask].mean()), sigma or float(max(values[mask].std(ddof=1), 1e-9))

    return find_consensus(
        len(values),
        "values",
        sample_size=2,
        noise_known=sigma is not None,
        initialise=lambda mask: (float(values[mask].mean()), sigma or 1.0),
        refine=refine,
        linearise=lambda state: (
            (values[:, None] - state[0]) / state[1],
            np.full((len(values), 1, 1), -1.0 / state[1]),
        ),
    )


@pytest.mark.parametrize("sigma", [0.2, None])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_outliers_are_separated_from_inliers(sigma, share):
    rng = np.random.default_rng(1)
    values = 7.0 + rng.normal(scale=0.2, size=60)
    wrong = rng.choice(60, int(60 * share), replace=False)
    values[wrong] += rng.uniform(4.0, 30.0, len(wrong))
    good, (mean, _) = robust_mean(values, sigma)
    assert set(np.flatnonzero(~good)) == set(wrong.tolist())
    assert mean == pytest.approx(values[good].mean())


def test_result_is_reproducible():
    values = np.random.default_rng(2).standard_t(2, size=40)
    first, second = robust_mean(values, None), robust_mean(values, None)
    assert np.array_equal(first[0], second[0]) and first[1] == second[1]


def test_clean_set_rarely_loses_a_value(sample):
    rng = np.random.default_rng(3)
    trials = 75 * sample
    losses = sum(not robust_mean(rng.normal(size=30), 1.0)[0].all() for _ in range(trials))
    assert losses <= trials / 30, "one clean set in a hundred may lose a value"


@pytest.mark.parametrize("sigma", [1.0, None])
@pytest.mark.parametrize("count", [6, 9])
def test_small_clean_set_rarely_loses_a_value(count, sigma, sample):
    """With plain residuals, a few close values would reject the others."""
    rng = np.random.default_rng(5)
    trials = 30 * sample
    losses = sum(not robust_mean(rng.normal(size=count), sigma)[0].all() for _ in range(trials))
    assert losses <= trials / 20, "one clean set in a hundred may lose a value"


def test_one_outlier_of_few_is_found_with_unknown_noise():
    values = np.array([0.1, -0.2, 0.15, 0.0, -0.05, 0.12, 9.0])
    good, _ = robust_mean(values, None)
    assert good.tolist() == [True] * 6 + [False]


@pytest.mark.parametrize("sigma", [0.3, None])
def test_consistency_agrees_with_explicit_refits(sigma, sample):
    rng = np.random.default_rng(9)
    consistent = []
    for _ in range(60 * sample):
        design = rng.normal(size=(7, 2, 3))
        values = design @ [1.0, -2.0, 0.5] + rng.standard_t(1.5, size=(7, 2)) * 0.3
        good = np.arange(7) < rng.integers(4, 8)
        used = design[good].reshape(-1, 3), values[good].ravel()
        answer, (rest,), *_ = np.linalg.lstsq(*used, rcond=None)
        scale = sigma or np.sqrt(rest / (2 * good.sum() - 3))
        residuals, jacobian = (values - design @ answer) / scale, -design / scale
        found = _consistent_with_fit(residuals, jacobian, good, noise_known=sigma is not None)
        expected = consistent_by_refits(values, design, good, sigma, FALSE_REJECTION_RATE)
        assert found.tolist() == expected
        consistent += found.tolist()
    assert 0.1 < np.mean(consistent) < 0.98


def test_missing_majority_is_an_error():
    values = np.repeat([0.0, 50.0, 100.0, 150.0], 5) + np.tile(np.linspace(-0.1, 0.1, 5), 4)
    message = r"only \d+ of 20 values agree; expected at least 11"
    with pytest.raises(NoConsensusError, match=message):
        robust_mean(values, 0.2)


def test_agreeing_minority_is_an_error():
    """Eight of 19 values agree, in the middle of all."""
    values = np.concatenate([np.linspace(-0.1, 0.1, 8), [50.0, -50.0], 500.0 * np.arange(-5, 0)])
    values = np.concatenate([values, 500.0 * np.arange(1, 5)])
    with pytest.raises(NoConsensusError, match="only 8 of 19 values agree; expected at least 10"):
        robust_mean(values, 0.2)


def consensus_of_double(count, linearise, refine=lambda mask, state: state):
    """The consensus on values with a test double of their fit."""
    return find_consensus(
        count,
        "values",
        sample_size=2,
        noise_known=True,
        initialise=lambda mask: 0,
        refine=refine,
        linearise=linearise,
    )


def test_undetermined_parameter_is_an_error():
    message = r"the values that agree \(4 of 4\) leave part of the"
    with pytest.raises(NoConsensusError, match=message):
        consensus_of_double(4, lambda state: (np.zeros((4, 1)), np.zeros((4, 1, 1))))


def alternating(odd: slice, even: slice) -> tuple[Callable, Callable]:
    """A fit whose refits reject ``odd`` and ``even`` of 20 values in turn."""
    rounds = iter(range(1, 100))

    def linearise(state: int) -> tuple[FloatArray, FloatArray]:
        residuals = np.zeros((20, 1))
        residuals[odd if state % 2 else even] = 50.0
        return residuals, np.full((20, 1, 1), 1e-3)

    return linearise, lambda mask, state: next(rounds)


def test_refits_that_alternate_end_without_the_undecided():
    """Value 9 agrees only in every second refit."""
    good, _ = consensus_of_double(20, *alternating(slice(9, 10), slice(0, 0)))
    assert np.flatnonzero(~good).tolist() == [9]


def test_refits_between_which_many_change_are_refused():
    with pytest.raises(NoConsensusError, match="values agree in one refit and not in the next"):
        consensus_of_double(20, *alternating(slice(0, 5), slice(5, 10)))
