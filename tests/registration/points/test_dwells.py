"""Detection of dwells in simulated recordings of a stylus."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Stamp, TrackedTransform, TrackingStatus, Transform
from app.registration import DwellSettings, ShapeError, detect_dwells

RATE_HZ = 20.0


def straight_motion(rng, tip, to, seconds, turn_rad):
    """Tip positions (3,) and rotations (3, 3) of a straight motion at `RATE_HZ`."""
    steps = int(seconds * RATE_HZ)
    share = np.linspace(0.0, 1.0, steps, endpoint=False)
    places = [tip + f * (to - tip) + rng.normal(scale=0.05, size=3) for f in share]
    turns = [[turn_rad * np.sin(3.0 * f), 0.2, 0.0] for f in share]
    return list(zip(places, Rotation.from_rotvec(turns).as_matrix(), strict=True))


def samples(track: list[tuple[FloatArray, FloatArray]]) -> list[TrackedTransform]:
    poses = [Transform("reference", "tip", rotation, tip) for tip, rotation in track]
    stamps = [Stamp(int(index / RATE_HZ * 1e9)) for index in range(len(track))]
    return list(map(TrackedTransform.valid, poses, stamps))


def later(track: list[TrackedTransform], ns: int) -> list[TrackedTransform]:
    return [
        TrackedTransform(s.transform, s.stamp.shifted(ns, s.stamp.clock), s.status) for s in track
    ]


LANDMARKS = np.array([[0, 0, 0], [60, 0, 0], [60, 50, 0], [0, 40, 30]], dtype=float)


def visit_landmarks(rng, turn_rad, seconds=2.5):
    track: list[tuple[FloatArray, FloatArray]] = []
    for landmark, following in zip(LANDMARKS, [*LANDMARKS[1:], LANDMARKS[0] + 300.0], strict=True):
        track += straight_motion(rng, landmark, landmark, seconds, turn_rad)
        track += straight_motion(rng, landmark, following, 1.5, turn_rad)
    return samples(track)


def test_every_dwell_has_its_position_and_time():
    dwells = detect_dwells(visit_landmarks(np.random.default_rng(1), 0.6))
    assert len(dwells) == 4
    for index, dwell in enumerate(dwells):
        np.testing.assert_allclose(dwell.position_mm, LANDMARKS[index], atol=0.05)
        assert dwell.start.ns / 1e9 == pytest.approx(4.0 * index, abs=0.2)
        assert dwell.end.ns / 1e9 == pytest.approx(4.0 * index + 2.5, abs=0.2)
        assert dwell.turn_rad > 0.3 and dwell.spread_mm < 0.15


def test_rest_without_rotation_is_a_dwell_only_if_allowed():
    track = visit_landmarks(np.random.default_rng(2), 0.0)
    assert detect_dwells(track) == ()
    assert len(detect_dwells(track, DwellSettings(min_turn_rad=0.0))) == 4


def test_short_stop_is_not_a_dwell():
    assert detect_dwells(visit_landmarks(np.random.default_rng(3), 2.0, seconds=0.6)) == ()


def test_landmark_visited_twice_is_one_dwell():
    rng = np.random.default_rng(4)
    once = visit_landmarks(rng, 0.6)
    offset = once[-1].stamp.ns + 10**9
    again = later(visit_landmarks(rng, 0.6), offset)
    assert len(detect_dwells([*once, *again])) == 4


def test_dwell_does_not_span_a_gap():
    """The tip is at rest before and after a gap without samples."""
    rng = np.random.default_rng(5)
    position = np.zeros(3)
    first = samples(straight_motion(rng, position, position, 0.7, 2.0))
    late = later(samples(straight_motion(rng, position, position, 0.7, 2.0)), 2 * 10**9)
    assert detect_dwells([*first, *late]) == ()
    lost = [
        TrackedTransform.lost("reference", "tip", Stamp(int(0.7e9) + i), TrackingStatus.INVALID)
        for i in range(5)
    ]
    assert detect_dwells([*first, *lost, *late]) == ()


def test_settings_and_time_order_are_validated():
    with pytest.raises(ShapeError, match="tip_box_mm"):
        DwellSettings(tip_box_mm=-1.0)
    with pytest.raises(ShapeError, match="longer than dwell_s"):
        DwellSettings(window_s=2.0)
    track = visit_landmarks(np.random.default_rng(6), 0.6)
    with pytest.raises(ShapeError, match="valid sample 6 of a stylus goes back in time"):
        detect_dwells([*track[:5], track[7], *track[5:7]])
