"""Breach probabilities: closed form, Monte Carlo, and their calibration on simulated cases."""

import numpy as np
import pytest
from scipy.stats import norm

from app.analysis.breach_probability import (
    breach_probability,
    moment_probabilities,
    smoothed_distances,
)
from app.geometry import InputError
from tests.analysis.simulated_outcomes import predictions

pytestmark = pytest.mark.long

RADIUS_MM = 12.0
SIGMAS = {"registration": 0.9, "pivot": 0.4, "contour": 0.6}
COVARIANCES = {name: sigma**2 * np.eye(3) for name, sigma in SIGMAS.items()}
TOTAL = float(np.sqrt(sum(sigma**2 for sigma in SIGMAS.values())))


def test_anisotropic_error_counts_along_the_normal():
    covariances = {"a": np.diag([4.0, 0.0, 0.0]), "b": np.diag([0.0, 1.0, 0.0])}
    normals = np.eye(3)
    found = moment_probabilities(np.ones(3), normals, covariances)
    assert found == pytest.approx([norm.cdf(-0.5), norm.cdf(-1.0), 0.0])


def test_moments_of_a_case_share_their_error():
    """A hundred moments at one place are no more probable than one; opposite sides add up."""
    same = breach_probability(
        np.full(100, 1.5), np.tile([1.0, 0.0, 0.0], (100, 1)), np.ones(100), COVARIANCES
    )
    both = breach_probability(
        np.full(2, 1.5), np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), np.ones(2), COVARIANCES
    )
    assert same.outcome.probability == pytest.approx(norm.cdf(-1.5 / TOTAL), abs=0.015)
    assert both.outcome.probability == pytest.approx(2.0 * norm.cdf(-1.5 / TOTAL), abs=0.02)


def test_the_largest_source_contributes_most_and_a_larger_margin_helps():
    distances = np.array([0.5, 3.0])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = breach_probability(
        distances, normals, np.array([0.2, 0.4]), COVARIANCES, stops_mm=(0.0, 1.0, 2.0, 3.5)
    )
    without = {name: effect.without.probability for name, effect in found.sources.items()}
    assert min(without, key=without.__getitem__) == "registration"
    assert all(value < found.outcome.probability for value in without.values())
    probabilities = [stop.outcome.probability for stop in found.stops]
    assert probabilities[0] == found.outcome.probability
    assert probabilities == sorted(probabilities, reverse=True)
    assert [stop.held_s for stop in found.stops] == pytest.approx([0.0, 0.2, 0.2, 0.6])


def check_calibration(count: int, brier_abs: float, share: float) -> None:
    """A point passes a ball; what is measured is displaced by an error that the case keeps."""
    random = np.random.default_rng(7)
    predicted, true = [], []
    for _ in range(count):
        start, end = random.normal(size=(2, 3))
        along = np.linspace(0.0, 1.0, 15)[:, None]
        directions = (1.0 - along) * start + along * end
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        heights = random.uniform(-3.0, 7.0) + 3.0 * np.linspace(-1.0, 1.0, 15) ** 2
        tips = (RADIUS_MM + heights)[:, None] * directions
        error = sum(sigma * random.normal(size=3) for sigma in SIGMAS.values())
        measured = tips + error
        lengths = np.linalg.norm(measured, axis=1)
        found = breach_probability(
            lengths - RADIUS_MM, measured / lengths[:, None], np.ones(15), COVARIANCES
        )
        predicted.append(found.outcome.probability)
        true.append(float((np.linalg.norm(tips, axis=1) < RADIUS_MM).any()))
    probabilities, outcomes = np.array(predicted), np.array(true)
    brier = float(np.mean((probabilities - outcomes) ** 2))
    chance = float(np.mean((outcomes.mean() - outcomes) ** 2))
    assert brier < 0.5 * chance
    assert brier == pytest.approx(np.mean(probabilities * (1.0 - probabilities)), abs=brier_abs)
    for low in np.arange(0.0, 1.0, 0.2):
        chosen = (probabilities >= low) & (probabilities < low + 0.2)
        spread = np.sqrt(probabilities[chosen].mean() * (1.0 - probabilities[chosen].mean()))
        difference = outcomes[chosen].mean() - probabilities[chosen].mean()
        assert abs(difference) < share + 3.0 * spread / np.sqrt(chosen.sum())


def test_probabilities_of_simulated_cases_are_calibrated():
    """The bounds are 3 standard errors: sqrt(2000 / 250) times those of 2000 cases."""
    check_calibration(250, brier_abs=0.042, share=0.03)


def test_unknown_frames_have_no_probability():
    distances, normals = np.array([np.nan, -5.0]), np.array([[np.nan] * 3, [1.0, 0.0, 0.0]])
    found = breach_probability(distances, normals, np.ones(2), COVARIANCES)
    assert np.isnan(found.moments[0])
    assert found.outcome.probability == 1.0
    with pytest.raises(InputError, match="no frame has a distance"):
        breach_probability(distances[:1], normals[:1], np.ones(1), COVARIANCES)


def test_outcome_of_one_moment_is_that_of_the_normal_distribution():
    distance, held = 0.7, 0.3
    found = breach_probability(
        np.array([distance]), np.array([[0.0, 0.6, 0.8]]), np.array([held]), COVARIANCES
    )

    def check(outcome, sigma):
        assert outcome.probability == pytest.approx(norm.cdf(-distance / sigma), abs=0.02)
        assert outcome.inside_s == pytest.approx(held * norm.cdf(-distance / sigma))
        expected = distance + sigma * norm.ppf([0.05, 0.5, 0.95])
        assert outcome.lowest_mm == pytest.approx(expected, abs=0.08)

    assert found.moments[0] == pytest.approx(norm.cdf(-distance / TOTAL))
    assert found.outcome.probability == pytest.approx(found.moments[0], abs=0.015)
    check(found.outcome, TOTAL)
    shares = [effect.variance_share for effect in found.sources.values()]
    assert sum(shares) == pytest.approx(1.0)
    for name, effect in found.sources.items():
        variance = SIGMAS[name] ** 2
        assert effect.variance_share == pytest.approx(variance / TOTAL**2)
        check(effect.without, np.sqrt(TOTAL**2 - variance))
        check(effect.doubled, np.sqrt(TOTAL**2 + 3.0 * variance))


def test_lowest_distance_uses_all_moments_that_an_error_may_lower():
    """Against the plain minimum over all moments, with the same draws."""
    random = np.random.default_rng(3)
    distances = random.uniform(0.5, 9.0, 300)
    normals = random.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    found = breach_probability(distances, normals, np.ones(300), {"one": 4.0 * np.eye(3)}, seed=5)
    errors = 2.0 * np.random.default_rng(5).standard_normal((4000, 3))
    lowest = (distances[:, None] + normals @ errors.T).min(axis=0)
    assert found.outcome.probability == pytest.approx((lowest < 0.0).mean(), abs=2e-3)
    assert found.outcome.lowest_mm == pytest.approx(np.percentile(lowest, (5, 50, 95)), abs=0.02)


def test_smoothing_removes_jitter_and_keeps_a_slope():
    times = np.arange(0.0, 2.0, 0.02)
    noisy = 5.0 - 2.0 * times + np.random.default_rng(1).normal(0.0, 0.3, len(times))
    noisy[40:45] = np.nan
    found = smoothed_distances(times, noisy)
    assert np.isnan(found[40:45]).all()
    error = (found - (5.0 - 2.0 * times))[np.isfinite(found)]
    assert np.sqrt(np.mean(error**2)) < 0.15


@pytest.mark.parametrize("matrix", [np.eye(2), -np.eye(3), np.triu(np.ones((3, 3)))])
def test_other_covariances_are_refused(matrix):
    with pytest.raises(InputError, match="covariance of contour"):
        breach_probability(np.ones(1), np.eye(3)[:1], np.ones(1), {"contour": matrix})


def test_without_errors_the_prediction_is_the_truth():
    """The engine on the mesh and the radius function agree where nothing is off."""
    found = list(predictions(30, 3, jitter_mm=0.0, error_scale=0.02))
    assert 5 < sum(each.breach for each in found) < 25
    sure = [each for each in found if each.probability in (0.0, 1.0)]
    assert len(sure) >= 24
    assert all(each.breach == (each.probability == 1.0) for each in sure)
