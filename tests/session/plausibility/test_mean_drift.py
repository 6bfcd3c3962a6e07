"""The mean difference between tracker and joints: creeps, registration errors, breathing."""

import math

import numpy as np
import pytest

from app.geometry import NS_PER_S
from app.session.joint_check import MEAN_DRIFT, MEAN_S, START_NS, update_mean

pytestmark = pytest.mark.slow

LIMIT_MM = 2.5


def new_mean():
    mean = np.zeros(1, MEAN_DRIFT)[0]
    mean["limit_mm"] = LIMIT_MM
    return mean


def fed(differences, rate_hz=50.0, *, first_s=0.0):
    """Times in s at which the mean is exceeded, and the mean."""
    mean, exceeded = new_mean(), []
    for k, difference in enumerate(differences):
        at_s = first_s + k / rate_hz
        update_mean(mean, tuple(difference), round(at_s * NS_PER_S))
        if mean["exceeded"]:
            exceeded.append(at_s)
    return exceeded, mean


def creep(rate_mm_s: float, start_mm, seconds: float, rate_hz: float, seed: int):
    """An error that grows along x after 2 s, with the noise of an EM tracker."""
    random = np.random.default_rng(seed)
    for k in range(round(seconds * rate_hz)):
        grown = max(k / rate_hz - 2.0, 0.0) * rate_mm_s
        yield np.array(start_mm) + grown * np.eye(3)[0] + random.normal(0.0, 0.25, 3)


@pytest.mark.parametrize("rate_mm_s", [0.5, 2.0, 10.0])
@pytest.mark.parametrize("rate_hz", [15.0, 50.0, 200.0])
@pytest.mark.parametrize("offset_mm", [0.0, 1.0, 3.0])
def test_creep_is_found_within_the_stated_bound(rate_mm_s, rate_hz, offset_mm):
    """The worst constant error points against the creep; 0.6 mm are left for noise."""
    for seed in range(2):
        differences = creep(rate_mm_s, (-offset_mm, 0.0, 0.0), 20.0, rate_hz, seed)
        (first_s, *_), _ = fed(differences, rate_hz)
        error_mm = (first_s - 2.0) * rate_mm_s
        bound_mm = LIMIT_MM + offset_mm + rate_mm_s * (MEAN_S + 1.0 / rate_hz)
        assert LIMIT_MM - 0.6 < error_mm < bound_mm + 0.6


def test_constant_error_of_the_registration_is_no_drift():
    random = np.random.default_rng(1)
    exceeded, mean = fed(np.array([4.0, 0.0, 0.0]) + random.normal(0.0, 0.25, (3000, 3)))
    assert exceeded == []
    assert np.linalg.norm(mean["mean"]) == pytest.approx(4.0, abs=0.3)


def test_breathing_of_the_reference_is_no_drift():
    times = np.arange(0.0, 120.0, 0.02)
    breath = 2.0 * np.sin(math.pi * 0.25 * times) ** 4
    exceeded, _ = fed(np.column_stack([breath, 0.0 * breath, 0.0 * breath]))
    assert exceeded == []


def test_single_outliers_are_no_drift():
    differences = np.zeros((500, 3))
    differences[::50, 0] = 4.9
    assert fed(differences)[0] == []


def test_neither_silence_nor_a_clock_that_is_set_back_ends_a_drift():
    exceeded, mean = fed([(0.0, 0.0, 0.0)] * 100 + [(3.0, 0.0, 0.0)] * 100)
    assert exceeded
    assert mean["exceeded"]
    update_mean(mean, (3.0, 0.0, 0.0), 0)
    assert mean["exceeded"]


def test_mean_equals_an_exponential_average_by_its_definition():
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.001, 0.1, 200)) + 2.0 * START_NS / NS_PER_S
    values = random.normal(0.0, 1.0, (200, 3))
    mean = new_mean()
    for at_s, value in zip(times, values, strict=True):
        update_mean(mean, tuple(value), round(at_s * NS_PER_S))
    # Each value counts for the interval before it, the first one for all time before.
    edges = np.exp(-(times[-1] - times) / MEAN_S)
    weights = np.diff(np.concatenate([[0.0], edges]))
    weights[0] = edges[0]
    expected = np.linalg.norm(weights @ values)
    assert np.linalg.norm(mean["mean"]) == pytest.approx(float(expected), rel=1e-6)
