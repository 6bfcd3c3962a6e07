"""Motion of the tip, its jitter, and the filter of both."""

import numpy as np
import pytest

from app.analysis import PHASES, Jitter, estimate_jitter, motion_of, phases_of
from app.analysis.motion import raw_path_mm, savitzky_golay
from app.geometry import InputError

TIMES = np.arange(0.0, 10.0, 0.02)


def circle(radius_mm: float, rad_s: float) -> np.ndarray:
    angle = rad_s * TIMES
    return np.column_stack([radius_mm * np.cos(angle), radius_mm * np.sin(angle), 0.0 * angle])


def test_circle_has_its_length_speed_and_jerk():
    found = motion_of(TIMES, circle(20.0, 1.5), 0.06)
    assert found.path_mm == pytest.approx(20.0 * 1.5 * 9.98, rel=1e-3)
    assert found.mean_speed_mm_s == pytest.approx(30.0, rel=1e-3)
    assert found.max_speed_mm_s == pytest.approx(30.0, rel=5e-3)
    assert found.rms_jerk_mm_s3 == pytest.approx(20.0 * 1.5**3, rel=0.02)
    assert found.idle_s == 0.0


def test_jitter_lengthens_the_raw_path_only():
    noisy = circle(20.0, 1.5) + np.random.default_rng(1).normal(0.0, 0.2, (len(TIMES), 3))
    found = motion_of(TIMES, noisy, 0.06)
    assert found.path_mm == pytest.approx(20.0 * 1.5 * 9.98, rel=0.03)
    assert found.raw_path_mm > 1.15 * found.path_mm


def test_idle_time_is_that_of_slow_pieces():
    tips = circle(20.0, 1.5)
    tips[200:300] = tips[200]
    assert motion_of(TIMES, tips, 0.06).idle_s == pytest.approx(2.0, abs=0.4)


def test_gap_is_in_no_figure():
    tips = circle(20.0, 1.5)
    tips[100:400] = np.nan
    found = motion_of(TIMES, tips, 0.06)
    assert found.tracked_s == pytest.approx(1.98 + 1.98)
    assert found.path_mm == pytest.approx(30.0 * 3.96, rel=2e-3)
    assert raw_path_mm(TIMES, tips, 0.06) == pytest.approx(30.0 * 3.96, rel=2e-3)


def test_no_tip_gives_no_figures():
    found = motion_of(TIMES, np.full((len(TIMES), 3), np.nan), 0.06)
    assert (found.path_mm, found.mean_speed_mm_s, found.log_dimensionless_jerk) == (0.0, None, None)


def test_phases_follow_the_rule():
    distances = np.full(len(TIMES), 30.0)
    distances[100:200] = np.linspace(30.0, 4.0, 100)
    distances[200:300] = 3.0
    distances[300:400] = np.linspace(3.0, 30.0, 100)
    distances[450:] = np.nan
    names = [PHASES[k] for k in phases_of(TIMES, distances, 5.0)]
    assert [names[k] for k in (50, 150, 250, 350, 480)] == [
        "away",
        "approach",
        "cutting",
        "away",
        "unknown",
    ]


LONG_TIMES = np.arange(0.0, 30.0, 0.02)


def noise(sigma: float, tau: float | None, seed: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    values = random.normal(size=len(LONG_TIMES))
    if tau is not None:
        keep = np.exp(-0.02 / tau)
        for k in range(1, len(values)):
            values[k] = keep * values[k - 1] + np.sqrt(1.0 - keep**2) * values[k]
    return sigma * values


def test_white_jitter_beside_a_motion():
    found = estimate_jitter(LONG_TIMES, 8.0 + 3.0 * np.sin(LONG_TIMES) + noise(0.3, None))
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.06)
    assert found.covariance(LONG_TIMES[:3])[0, 1] < 0.03


def test_correlated_jitter_has_the_autocorrelation_of_its_process():
    motion, found = 8.0 + 3.0 * np.sin(LONG_TIMES), []
    for seed in range(1, 8):
        jitter = estimate_jitter(LONG_TIMES, motion + noise(0.3, 0.04, seed))
        assert jitter is not None
        found.append(jitter.covariance(LONG_TIMES[:4])[0, 1:3])
    assert np.median(found, axis=0) / 0.09 == pytest.approx(np.exp([-0.5, -1.0]), abs=0.1)


def test_a_fast_motion_is_not_taken_for_jitter():
    plunges = 4.0 * np.maximum(0.0, np.sin(0.7 * LONG_TIMES)) ** 12
    found = estimate_jitter(LONG_TIMES, 8.0 - plunges + noise(0.3, None))
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.06)


def test_jitter_of_a_short_recording_is_unknown():
    assert estimate_jitter(LONG_TIMES[:50], LONG_TIMES[:50]) is None
    assert estimate_jitter(np.array([]), np.array([])) is None


def test_gaps_are_not_bridged():
    times = np.concatenate([LONG_TIMES[:300], 100.0 + LONG_TIMES[:300]])
    distances = np.concatenate([np.zeros(300), np.full(300, 40.0)]) + noise(0.3, None)[:600]
    found = estimate_jitter(times, distances)
    assert found is not None
    assert found.sigma_mm == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("sigma", [0.0, np.nan, np.inf])
def test_a_jitter_out_of_range_is_refused(sigma):
    with pytest.raises(InputError, match="sigma_mm is"):
        Jitter(sigma)


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
@pytest.mark.parametrize(("count", "length"), [(40, 11), (11, 11), (8, 5)])
def test_equals_scipy_at_the_ends_too(count, length, derivative):
    from scipy.signal import savgol_filter  # half a second, for this test alone

    values = np.random.default_rng(count).normal(size=(count, 3)).cumsum(axis=0)
    found = savitzky_golay(values, length, 3, derivative=derivative, step=0.02)
    expected = savgol_filter(values, length, 3, deriv=derivative, delta=0.02, axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_cubic_keeps_its_values_and_derivatives():
    times = 0.02 * np.arange(30)[:, None]
    for derivative, expected in enumerate(
        (2 * times**3 - times, 6 * times**2 - 1, 12 * times, 12 + 0 * times)
    ):
        found = savitzky_golay(2 * times**3 - times, 9, 3, derivative=derivative, step=0.02)
        np.testing.assert_allclose(found, expected, atol=1e-8)
