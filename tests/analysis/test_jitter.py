import numpy as np
import pytest

from app.analysis import Jitter, estimate_jitter
from app.geometry import InputError

TIMES = np.arange(0.0, 30.0, 0.02)


def noise(sigma: float, tau: float | None, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    values = random.normal(size=len(TIMES))
    if tau is not None:
        keep = np.exp(-0.02 / tau)
        for k in range(1, len(values)):
            values[k] = keep * values[k - 1] + np.sqrt(1.0 - keep**2) * values[k]
    return sigma * values


def test_white_jitter_beside_a_motion():
    found = estimate_jitter(TIMES, 8.0 + 3.0 * np.sin(TIMES) + noise(0.3, None))
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.06)
    assert found.covariance(TIMES[:3])[0, 1] < 0.03


def test_correlated_jitter_has_the_autocorrelation_of_its_process():
    found = estimate_jitter(TIMES, 8.0 + 3.0 * np.sin(TIMES) + noise(0.3, 0.04))
    assert found is not None
    covariance = found.covariance(TIMES[:4])
    assert covariance[0, 1:3] / 0.09 == pytest.approx(np.exp([-0.5, -1.0]), abs=0.1)


def test_a_fast_motion_is_not_taken_for_jitter():
    plunges = 4.0 * np.maximum(0.0, np.sin(0.7 * TIMES)) ** 12
    found = estimate_jitter(TIMES, 8.0 - plunges + noise(0.3, None))
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.06)


def test_jitter_of_a_short_recording_is_unknown():
    assert estimate_jitter(TIMES[:50], TIMES[:50]) is None
    assert estimate_jitter(np.array([]), np.array([])) is None


def test_gaps_are_not_bridged():
    times = np.concatenate([TIMES[:300], 100.0 + TIMES[:300]])
    distances = np.concatenate([np.zeros(300), np.full(300, 40.0)]) + noise(0.3, None)[:600]
    found = estimate_jitter(times, distances)
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("sigma", [0.0, np.nan, np.inf])
def test_a_jitter_out_of_range_is_refused(sigma):
    with pytest.raises(InputError, match="sigma_mm is"):
        Jitter(sigma)
