"""Correlation of noise beside the motion of simulated records."""

import numpy as np
import pytest

from app.analysis import estimate_jitter
from app.geometry.correlated_noise import Correlation, estimate_noise
from tests.analysis.simulated_breaches import simulate

pytestmark = pytest.mark.slow

MEAN_S = 0.2


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
@pytest.mark.parametrize("kind", ["white", "correlated", "slow", "pink"])
def test_error_of_a_mean_is_that_of_the_true_noise(kind, rate_hz):
    """The mean over 0.2 s, on which the interval of a depth depends."""
    times = np.arange(0.0, MEAN_S, 1.0 / rate_hz)
    ratios = []
    for seed in range(20):
        record = simulate(kind, seed, rate_hz)
        found = estimate_jitter(record.times_s, record.distances_mm)
        true = record.jitter.covariance(times).mean()
        ratios.append(np.sqrt(found.covariance(times).mean() / true))
    assert 0.85 < np.mean(ratios) < 1.6


def test_correlation_of_a_long_series_is_found():
    random = np.random.default_rng(1)
    values = random.standard_normal((40, 200))
    for k in range(1, 200):
        values[:, k] = 0.8 * values[:, k - 1] + 0.6 * values[:, k]
    times = np.tile(np.arange(200.0), (40, 1))
    variance, correlation, used = estimate_noise(
        times, values, degree=0, overlap=1.0, longest=1000.0
    )
    assert used == 40
    assert variance == pytest.approx(1.0, rel=0.15)
    assert correlation.matrix(times[0, :3])[0, 1:] == pytest.approx([0.8, 0.64], abs=0.06)


def test_matrix_has_ones_where_times_are_equal():
    matrix = Correlation((0.5,), (2.0,)).matrix(np.array([0.0, 2.0]), np.array([0.0, 4.0]))
    half = 0.5 * np.exp([-2.0, -1.0, -1.0])
    np.testing.assert_allclose(matrix, [[1.0, half[0]], [half[1], half[2]]])
