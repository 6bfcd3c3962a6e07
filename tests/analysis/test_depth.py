import numpy as np
import pytest

from app.analysis import Jitter, estimate_depth
from app.geometry import InputError
from tests.analysis.simulated_breaches import DepthErrors

pytestmark = pytest.mark.long

TIMES = np.arange(0.0, 2.0, 0.02)


def dip(times: np.ndarray) -> np.ndarray:
    return 6.0 - 9.0 * np.exp(-0.5 * ((times - 1.0) / 0.25) ** 2)


def check_bias(kind: str, count: int) -> None:
    """Limits are 3 standard errors wider than those of `test_long_depth`."""
    found = DepthErrors.over(kind, count)
    assert found.lowest_sample_bias_mm < -0.2
    assert abs(found.bias_mm) < 0.05 + 3.0 * found.standard_error_mm
    assert found.coverage >= 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / count)


def check_coverage_of_turns(count: int, least: float) -> None:
    """Hyperbolas with 1000 to 2000 mm/s2 at their lowest point, at 30 Hz."""
    random, covered = np.random.default_rng(3), []
    for _ in range(count):
        times = np.arange(0.0, 1.4, 1.0 / 30.0) + random.uniform(0.0, 1.0 / 30.0)
        speed, acceleration = random.uniform(60.0, 150.0), random.uniform(1000.0, 2000.0)
        depth = random.uniform(1.0, 6.0)
        bottom = speed**2 / acceleration
        truth = np.hypot(speed * (times - 0.7), bottom) - bottom - depth
        noisy = truth + 0.18 * random.standard_normal(len(times))
        found = estimate_depth(times, noisy, Jitter(0.18), start_s=0.5, end_s=0.9)
        covered.append(found.low_mm <= -depth <= found.high_mm)
    assert np.mean(covered) >= least


@pytest.mark.parametrize("kind", ["white", "correlated"])
def test_estimate_is_less_biased_than_the_lowest_sample(kind):
    check_bias(kind, 12)


def test_interval_holds_the_depth_of_a_tool_that_turns_fast():
    check_coverage_of_turns(20, 0.75)


def test_without_jitter_the_estimate_is_the_minimum():
    found = estimate_depth(TIMES + 0.007, dip(TIMES + 0.007), Jitter(0.002), start_s=0.7, end_s=1.3)
    assert found.distance_mm == pytest.approx(-3.0, abs=0.01)
    assert found.low_mm <= -3.0 <= found.high_mm
    assert found.high_mm - found.low_mm < 0.05
    assert found.inside_probability == 1.0
    assert found.depth_mm == -found.distance_mm


def test_interval_grows_with_the_correlation_and_with_a_bias():
    def width(jitter: Jitter, bias_mm: float = 0.0) -> float:
        noisy = dip(TIMES) + np.random.default_rng(3).normal(0.0, 0.3, len(TIMES))
        found = estimate_depth(TIMES, noisy, jitter, start_s=0.7, end_s=1.3, bias_sigma_mm=bias_mm)
        return found.high_mm - found.low_mm

    white = width(Jitter(0.3))
    assert width(Jitter(0.3, 1.0, 0.08)) > 1.5 * white
    assert width(Jitter(0.3), bias_mm=0.5) == pytest.approx(2 * 1.96 * 0.5, rel=0.15)


def test_a_breach_by_jitter_alone_has_a_low_probability():
    random = np.random.default_rng(1)
    noisy = 0.8 + random.normal(0.0, 0.3, len(TIMES))
    at = int(np.argmin(noisy))
    assert noisy[at] < 0.2
    found = estimate_depth(
        TIMES, noisy, Jitter(0.3), start_s=TIMES[at] - 0.1, end_s=TIMES[at] + 0.1
    )
    assert found.inside_probability < 0.05
    assert 0.4 < found.distance_mm < 0.8


def check_long_breach(seconds, deepest_s):
    times = np.arange(0.0, seconds, 0.02)
    truth = -1.0 - np.exp(-0.5 * ((times - deepest_s) / 0.5) ** 2)
    noisy = truth + np.random.default_rng(2).normal(0.0, 0.3, len(times))
    found = estimate_depth(times, noisy, Jitter(0.3), start_s=0.0, end_s=seconds - 0.02)
    assert found.low_mm <= -2.0 <= found.high_mm
    assert found.distance_mm == pytest.approx(-2.0, abs=0.25)


def test_long_breach_is_evaluated_in_parts():
    check_long_breach(5.0, 3.5)


def test_same_seed_gives_the_same_numbers():
    noisy = dip(TIMES) + np.random.default_rng(3).normal(0.0, 0.3, len(TIMES))
    one, two = (
        estimate_depth(TIMES, noisy, Jitter(0.3), start_s=0.7, end_s=1.3, seed=4) for _ in range(2)
    )
    assert one == two


def test_one_sample_is_enough():
    found = estimate_depth(np.array([1.0]), np.array([-0.5]), Jitter(0.3), start_s=1.0, end_s=1.0)
    assert found.distance_mm == pytest.approx(-0.5, abs=0.1)
    assert found.high_mm - found.low_mm > 1.0


@pytest.mark.parametrize(
    ("times", "distances", "problem"),
    [
        ([], [], "n > 0"),
        ([0.0, 1.0], [1.0], "expected \\(n,\\) for both"),
        ([0.0, np.nan], [1.0, 1.0], "not finite"),
        ([0.0, 0.0], [1.0, 1.0], "do not increase"),
    ],
)
def test_bad_samples_are_refused(times, distances, problem):
    with pytest.raises(InputError, match=problem):
        estimate_depth(np.array(times), np.array(distances), Jitter(0.3), start_s=0.0, end_s=1.0)
