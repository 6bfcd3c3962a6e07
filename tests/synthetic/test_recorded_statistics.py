"""Made samples have the intervals, repeats, jitter and correlation of public recordings."""

import pytest

from tests.synthetic.recorded_statistics import (
    EIGHT,
    POLARIS_AT_15_HZ,
    RAS,
    TRAKSTAR_AT_15_HZ,
    made,
    recorded,
)


@pytest.fixture(scope="module")
def stylus():
    return recorded(EIGHT, "StylusToTracker")


@pytest.fixture(scope="module")
def reference():
    return recorded(EIGHT, "ReferenceToTracker")


@pytest.fixture(scope="module")
def trakstar():
    return made(TRAKSTAR_AT_15_HZ, 66.0)


def test_intervals_are_as_irregular_as_recorded(stylus, trakstar):
    assert trakstar.interval_ms == pytest.approx(stylus.interval_ms, rel=0.002)
    assert trakstar.interval_sd_ms == pytest.approx(stylus.interval_sd_ms, rel=0.4)
    assert stylus.doubled == pytest.approx(0.004, abs=0.0005) and 0.0 < trakstar.doubled < 0.012


def test_digits_and_repeats_are_as_recorded(stylus, reference, trakstar):
    assert trakstar.step_mm == pytest.approx(stylus.step_mm, rel=1e-4)
    assert 0.5 * reference.repeated_positions < trakstar.repeated_positions
    assert trakstar.repeated_positions < stylus.repeated_positions
    assert 0.001 < trakstar.repeated_poses < 0.015


def test_jitter_at_rest_is_between_the_two_recorded_sensors(stylus, reference, trakstar):
    assert stylus.jitter_mm < trakstar.jitter_mm < reference.jitter_mm
    assert reference.jitter_deg < trakstar.jitter_deg < stylus.jitter_deg


def test_jitter_lasts_as_long_as_recorded(stylus, reference, trakstar):
    low, high = stylus.autocorrelation_s, reference.autocorrelation_s
    assert 0.8 * low < trakstar.autocorrelation_s < 1.3 * high


def test_optical_preset_is_like_a_recording_with_the_digits_of_ndi():
    if not RAS.exists():
        pytest.skip("no ../shared/data beside the project")
    real = recorded(RAS, "ReferenceToTracker")
    # 93 samples with a correlation over several of them: averaged over ten made ones.
    found = [made(POLARIS_AT_15_HZ, 6.2, seed) for seed in range(10)]

    def mean(field):
        return sum(getattr(one, field) for one in found) / len(found)

    assert mean("step_mm") == pytest.approx(real.step_mm, rel=1e-6)
    assert mean("interval_ms") == pytest.approx(real.interval_ms, rel=0.03)
    assert mean("jitter_mm") == pytest.approx(real.jitter_mm, rel=0.35)
    assert mean("jitter_deg") == pytest.approx(real.jitter_deg, rel=0.35)
    assert mean("autocorrelation_s") == pytest.approx(real.autocorrelation_s, rel=0.4)
