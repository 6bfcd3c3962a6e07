import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import DwellSettings, ShapeError, detect_dwells

RATE_HZ = 20.0


def stretch(
    rng: np.random.Generator, tip: FloatArray, to: FloatArray, seconds: float, turn_rad: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Tip and rotation while the tip goes from one place to another."""
    steps = int(seconds * RATE_HZ)
    share = np.linspace(0.0, 1.0, steps, endpoint=False)
    return [
        (
            tip + f * (to - tip) + rng.normal(scale=0.05, size=3),
            Rotation.from_rotvec([turn_rad * np.sin(3.0 * f), 0.2, 0.0]).as_matrix(),
        )
        for f in share
    ]


def samples(track: list[tuple[FloatArray, FloatArray]]) -> list[TrackedTransform]:
    return [
        TrackedTransform(
            Transform("reference", "tip", rotation, tip),
            Stamp(int(index / RATE_HZ * 1e9)),
            TrackingStatus.OK,
        )
        for index, (tip, rotation) in enumerate(track)
    ]


PLACES = np.array([[0, 0, 0], [60, 0, 0], [60, 50, 0], [0, 40, 30]], dtype=float)


def visit(
    rng: np.random.Generator, turn_rad: float, seconds: float = 2.5
) -> list[TrackedTransform]:
    track: list[tuple[FloatArray, FloatArray]] = []
    for here, there in zip(PLACES, [*PLACES[1:], PLACES[0] + 300.0], strict=True):
        track += stretch(rng, here, here, seconds, turn_rad)
        track += stretch(rng, here, there, 1.5, turn_rad)
    return samples(track)


def test_each_place_is_found_at_its_place_and_time() -> None:
    dwells = detect_dwells(visit(np.random.default_rng(1), 0.6))
    assert len(dwells) == 4
    for index, dwell in enumerate(dwells):
        np.testing.assert_allclose(dwell.position_mm, PLACES[index], atol=0.05)
        assert dwell.start.ns / 1e9 == pytest.approx(4.0 * index, abs=0.2)
        assert dwell.end.ns / 1e9 == pytest.approx(4.0 * index + 2.5, abs=0.2)
        assert dwell.turn_rad > 0.3 and dwell.spread_mm < 0.15


def test_a_stylus_that_lies_still_marks_nothing_unless_told_that_it_may() -> None:
    track = visit(np.random.default_rng(2), 0.0)
    assert detect_dwells(track) == ()
    assert len(detect_dwells(track, DwellSettings(min_turn_rad=0.0))) == 4


def test_a_short_stop_is_no_dwell() -> None:
    assert detect_dwells(visit(np.random.default_rng(3), 2.0, seconds=0.6)) == ()


def test_a_landmark_visited_twice_counts_once() -> None:
    rng = np.random.default_rng(4)
    once = visit(rng, 0.6)
    offset = once[-1].stamp.ns + 10**9
    again = [
        TrackedTransform(s.transform, s.stamp.shifted(offset, s.stamp.clock), s.status)
        for s in visit(rng, 0.6)
    ]
    assert len(detect_dwells([*once, *again])) == 4


def test_nothing_is_known_in_a_gap() -> None:
    """Still before and after, but the tracker was silent between: no dwell spans it."""
    rng = np.random.default_rng(5)
    place = np.zeros(3)
    first = samples(stretch(rng, place, place, 0.7, 2.0))
    late = [
        TrackedTransform(s.transform, s.stamp.shifted(2 * 10**9, s.stamp.clock), s.status)
        for s in samples(stretch(rng, place, place, 0.7, 2.0))
    ]
    assert detect_dwells([*first, *late]) == ()
    lost = [
        TrackedTransform.lost("reference", "tip", Stamp(int(0.7e9) + i), TrackingStatus.INVALID)
        for i in range(5)
    ]
    assert detect_dwells([*first, *lost, *late]) == ()


def test_settings_and_order_of_time_are_checked() -> None:
    with pytest.raises(ShapeError, match="tip_box_mm"):
        DwellSettings(tip_box_mm=-1.0)
    with pytest.raises(ShapeError, match="longer than dwell_s"):
        DwellSettings(window_s=2.0)
    track = visit(np.random.default_rng(6), 0.6)
    with pytest.raises(ShapeError, match="good sample 6 of a stylus goes back in time"):
        detect_dwells([*track[:5], track[7], *track[5:7]])
