"""Place, speed and depth of breaches whose truth is known by construction."""

import numpy as np
import pytest

from app.analysis.case_breaches import analyse_breaches
from app.analysis.samples import CaseSamples
from app.analysis.smoothing import estimate_jitter

pytestmark = pytest.mark.slow

TURN = np.eye(3).ravel().tolist()


def samples_of(times: np.ndarray, distances: np.ndarray) -> CaseSamples:
    """A tip above a ball of 12 mm, on +x; the nearest point of the tool is the tip."""
    rows = [
        (
            round(1e9 * t),
            0,
            False,
            (d, 1.0, 12.0 + d, 0.0, 0.0, *TURN, 12.0, *[0.0] * 5, 1.0, 0.0, 0.0),
        )
        for t, d in zip(times.tolist(), distances.tolist(), strict=True)
    ]
    return CaseSamples.from_rows(rows)


def found(times, distances, jitter=None):
    return analyse_breaches(
        samples_of(times, distances),
        jitter,
        stale_after_ns=200_000_000,
        centroid_mm=np.zeros(3),
        ras_from_tumor=None,
        bias_sigma_mm=0.0,
    )


def plunge(times: np.ndarray, speed_mm_s: float, depth_mm: float, start_s: float) -> np.ndarray:
    """Distances of a straight plunge at a constant speed, then a rest at its end."""
    return np.clip(-speed_mm_s * (times - start_s), -depth_mm, 30.0)


@pytest.mark.parametrize(("speed", "depth"), [(8.0, 4.0), (20.0, 1.5), (40.0, 2.2), (80.0, 4.5)])
def test_speed_at_entry_is_that_of_the_plunge(speed, depth):
    times = np.arange(0.0, 4.0, 0.025) + 0.004
    (breach,) = found(times, plunge(times, speed, depth, 2.0))
    assert breach.entry_speed_mm_s == pytest.approx(speed, rel=0.02)
    assert (breach.side, breach.direction, breach.part) == ("right", "right", "tip")
    assert breach.start_s + times[0] == pytest.approx(2.0, abs=0.026)


def test_speed_at_entry_of_a_short_plunge_is_not_halved():
    times = np.arange(0.0, 4.0, 0.025) + 0.004
    (breach,) = found(times, plunge(times, 40.0, 1.0, 2.0))
    assert 30.0 < breach.entry_speed_mm_s < 40.0


def test_depth_of_a_frame_before_a_breach_is_not_that_of_the_breach():
    """One frame dips under 0 by jitter, 40 ms before a plunge of 6 mm."""
    random = np.random.default_rng(11)
    times = np.arange(0.0, 5.0, 0.02)
    distances = plunge(times, 20.0, 6.0, 4.0) + random.normal(0.0, 0.12, len(times))
    early = int(np.argmin(np.abs(times - 3.96)))
    distances[early - 2 : early + 2] = 0.8, 0.5, -0.05, 0.5
    jitter = estimate_jitter(times, distances)
    assert jitter is not None
    first, second = found(times, distances, jitter)[:2]
    assert (first.frames, first.duration_s) == (1, 0.0)
    assert first.estimate is not None
    assert second.estimate is not None
    assert first.estimate.distance_mm > -0.4
    assert second.estimate.distance_mm == pytest.approx(-6.0, abs=0.2)
