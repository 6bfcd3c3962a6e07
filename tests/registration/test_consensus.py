import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as fisher

from app.geometry import FloatArray
from app.registration import NoConsensusError
from app.registration.consensus import WRONG_RATE, _agree, agreeing


def agreeing_mean(
    values: FloatArray, sigma: float | None
) -> tuple[NDArray[np.bool_], tuple[float, float]]:
    """The smallest estimator there is: a mean and, when not known, the noise about it."""

    def refine(mask: NDArray[np.bool_], _: tuple[float, float]) -> tuple[float, float]:
        return float(values[mask].mean()), sigma or float(max(values[mask].std(ddof=1), 1e-9))

    return agreeing(
        len(values),
        "values",
        draw=2,
        noise_known=sigma is not None,
        start=lambda mask: (float(values[mask].mean()), sigma or 1.0),
        refine=refine,
        linearise=lambda state: (
            (values[:, None] - state[0]) / state[1],
            np.full((len(values), 1, 1), -1.0 / state[1]),
        ),
    )


@pytest.mark.parametrize("sigma", [0.2, None])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_the_wrong_ones_are_told_from_the_good(sigma: float | None, share: float) -> None:
    rng = np.random.default_rng(1)
    values = 7.0 + rng.normal(scale=0.2, size=60)
    wrong = rng.choice(60, int(60 * share), replace=False)
    values[wrong] += rng.uniform(4.0, 30.0, len(wrong))
    good, (mean, _) = agreeing_mean(values, sigma)
    assert set(np.flatnonzero(~good)) == set(wrong.tolist())
    assert mean == pytest.approx(values[good].mean())


def test_the_same_values_give_the_same_answer() -> None:
    values = np.random.default_rng(2).standard_t(2, size=40)
    first, second = agreeing_mean(values, None), agreeing_mean(values, None)
    assert np.array_equal(first[0], second[0]) and first[1] == second[1]


def test_a_good_value_is_rarely_called_wrong() -> None:
    rng = np.random.default_rng(3)
    losses = sum(not agreeing_mean(rng.normal(size=30), 1.0)[0].all() for _ in range(300))
    assert losses <= 10, "one clean set in a hundred may lose a value"


@pytest.mark.parametrize("sigma", [1.0, None])
@pytest.mark.parametrize("count", [6, 9])
def test_a_small_clean_set_is_rarely_cut_down_to_what_agrees_best(
    count: int, sigma: float | None
) -> None:
    """Judged by plain misfits, a few that lie near each other would call the others wrong."""
    rng = np.random.default_rng(5)
    losses = sum(not agreeing_mean(rng.normal(size=count), sigma)[0].all() for _ in range(100))
    assert losses <= 5, "one clean set in a hundred may lose a value"


def test_one_wrong_value_of_few_is_found_where_the_noise_is_not_known() -> None:
    values = np.array([0.1, -0.2, 0.15, 0.0, -0.05, 0.12, 9.0])
    good, _ = agreeing_mean(values, None)
    assert good.tolist() == [True] * 6 + [False]


def foretold(
    values: FloatArray, design: FloatArray, good: NDArray[np.bool_], sigma: float | None
) -> list[bool]:
    """Each observation (n, 2) against a refit (n, 2, 3) of the good ones but for itself."""
    rate = 1.0 - WRONG_RATE / len(values)
    verdicts = []
    for one in range(len(values)):
        others = good & (np.arange(len(values)) != one)
        rows, right = design[others].reshape(-1, 3), values[others].ravel()
        answer, (rest,), *_ = np.linalg.lstsq(rows, right, rcond=None)
        freedom = len(right) - 3
        variance = rest / freedom if sigma is None else sigma**2
        spread = np.eye(2) + design[one] @ np.linalg.inv(rows.T @ rows) @ design[one].T
        miss = values[one] - design[one] @ answer
        squared = miss @ np.linalg.solve(spread, miss) / variance
        bound = 2.0 * fisher.ppf(rate, 2, freedom) if sigma is None else chi2.ppf(rate, 2)
        verdicts.append(bool(squared <= bound))
    return verdicts


@pytest.mark.parametrize("sigma", [0.3, None])
def test_each_is_judged_by_what_the_others_foretell(sigma: float | None) -> None:
    rng = np.random.default_rng(9)
    told = []
    for _ in range(200):
        design = rng.normal(size=(7, 2, 3))
        values = design @ [1.0, -2.0, 0.5] + rng.standard_t(1.5, size=(7, 2)) * 0.3
        good = np.arange(7) < rng.integers(4, 8)
        answer, (rest,), *_ = np.linalg.lstsq(
            design[good].reshape(-1, 3), values[good].ravel(), rcond=None
        )
        scale = sigma or np.sqrt(rest / (2 * good.sum() - 3))
        found = _agree(
            (values - design @ answer) / scale,
            -design / scale,
            good,
            noise_known=sigma is not None,
        )
        assert found.tolist() == foretold(values, design, good, sigma)
        told += found.tolist()
    assert 0.1 < np.mean(told) < 0.98


def test_no_majority_is_an_error() -> None:
    values = np.repeat([0.0, 50.0, 100.0, 150.0], 5) + np.tile(np.linspace(-0.1, 0.1, 5), 4)
    with pytest.raises(NoConsensusError, match=r"only \d+ of 20 values agree: at least 11"):
        agreeing_mean(values, 0.2)


def test_a_minority_that_agrees_is_none_either() -> None:
    """Eight of nineteen, in the middle of all: their own mean leaves them where they are."""
    values = np.concatenate([np.linspace(-0.1, 0.1, 8), [50.0, -50.0], 500.0 * np.arange(-5, 0)])
    values = np.concatenate([values, 500.0 * np.arange(1, 5)])
    with pytest.raises(NoConsensusError, match="only 8 of 19 values agree: at least 10"):
        agreeing_mean(values, 0.2)


def test_observations_that_say_nothing_of_a_parameter_are_refused() -> None:
    with pytest.raises(NoConsensusError, match="the values that agree, 4 of 4, leave part of the"):
        agreeing(
            4,
            "values",
            draw=2,
            noise_known=True,
            start=lambda mask: 0.0,
            refine=lambda mask, state: state,
            linearise=lambda state: (np.zeros((4, 1)), np.zeros((4, 1, 1))),
        )
