import numpy as np
import pytest

from app.analysis import PHASES, motion_of, phases_of
from app.analysis.motion import raw_path_mm

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
