"""Clock offset between signals of one motion."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import FloatArray, Stamp, StampError, TrackedTransform, TrackingStatus, Transform
from app.registration import (
    FlatSignalError,
    NotFiniteError,
    ShapeError,
    TimedSignal,
    TooFewError,
    UnequalCountsError,
    estimate_time_offset,
)
from tests.registration.helpers import random_transform
from tests.registration.time_signals import LAG_MS, Motion, in_ns, sample_times, streams


def test_offset_is_found_and_the_interval_covers_it(sample):
    trials = 8 * sample
    rng = np.random.default_rng(1)
    errors, covered = [], 0
    for _ in range(trials):
        result = estimate_time_offset(*streams(rng))
        assert result.accepted, result.reason
        errors.append(result.offset_ns / 1e6 - LAG_MS)
        covered += result.interval_ns[0] <= LAG_MS * 1e6 <= result.interval_ns[1]
    assert np.max(np.abs(errors)) < 1.0
    assert covered / trials >= 0.86


@pytest.mark.parametrize("drift", [-2e-3, -1e-4, 2e-3])
def test_drifting_clocks_are_not_accepted(drift):
    a, b = streams(np.random.default_rng(12))
    drifting = TimedSignal((b.times_ns * (1.0 + drift)).astype(np.int64), b.values, b.clock)
    result = estimate_time_offset(a, drifting)
    assert result.accepted == (abs(drift) < 1e-3)
    if not result.accepted:
        message = r"the offset changes by (\S+) ms .*; expected at most 10 ms"
        change = re.search(message, result.reason)
        assert change is not None
        assert float(change[1]) == pytest.approx(1e3 * 19.0 * drift, rel=0.25)


def test_noise_free_offset_is_exact():
    result = estimate_time_offset(*streams(np.random.default_rng(2), noise_mm=0.0))
    assert result.offset_ns / 1e6 == pytest.approx(LAG_MS, abs=1e-4)
    assert result.explained > 0.999999


def test_swapped_signals_give_the_opposite_offset():
    a, b = streams(np.random.default_rng(3))
    forward, backward = estimate_time_offset(a, b), estimate_time_offset(b, a)
    assert forward.offset_ns == pytest.approx(-backward.offset_ns, abs=4e5)
    assert (forward.clock_a, forward.clock_b) == ("robot", "tracker")
    assert (backward.clock_a, backward.clock_b) == ("tracker", "robot")


def test_gaps_in_a_signal_are_not_used():
    """Two gaps of 1 s in the robot's signal during the motion."""
    rng = np.random.default_rng(12)
    a, b = streams(rng, seconds=40.0)
    times = a.times_ns / 1e9
    recorded = ~(((times > 12.0) & (times < 13.0)) | ((times > 25.0) & (times < 26.0)))
    result = estimate_time_offset(TimedSignal(a.times_ns[recorded], a.values[recorded], a.clock), b)
    assert result.accepted, result.reason
    assert result.offset_ns / 1e6 == pytest.approx(LAG_MS, abs=1.0)
    assert result.explained > 0.99


def test_clocks_that_started_at_different_times_need_a_first_guess():
    a, b = streams(np.random.default_rng(4))
    far = 1_700_000_000 * 10**9
    shifted = TimedSignal(b.times_ns + far, b.values, b.clock)
    with pytest.raises(TooFewError, match="inside a"):
        estimate_time_offset(a, shifted)
    result = estimate_time_offset(a, shifted, around_ns=far)
    assert result.offset_ns - far == estimate_time_offset(a, b).offset_ns
    assert result.reason.startswith(f"{result.offset_ns / 1e6:.2f} ms")


def test_unregistered_robot_and_sensor_poses_are_aligned():
    """Unknown base, and an unknown lever arm of 80 mm that rotates by 40 degrees."""
    rng = np.random.default_rng(5)
    position, turning = Motion(rng, 3, 12.0), Motion(rng, 3, 0.25)
    base = random_transform(rng, "reference", "base")
    mount = random_transform(rng, "tip", "sensor", 80.0)

    def tip(times: FloatArray) -> list[Transform]:
        rotations = Rotation.from_rotvec(turning(times)).as_matrix()
        pairs = zip(rotations, position(times), strict=True)
        return [Transform("base", "tip", turn, place) for turn, place in pairs]

    def tracked(poses: list[Transform], times: FloatArray, clock: str) -> list[TrackedTransform]:
        return [
            TrackedTransform(pose, Stamp(int(ns), clock), TrackingStatus.OK)
            for pose, ns in zip(poses, in_ns(times), strict=True)
        ]

    robot_times, sensor_times = sample_times(rng, 100.0, 12.0), sample_times(rng, 50.0, 12.0)
    seen = [base @ pose @ mount for pose in tip(sensor_times)]
    noisy = [
        Transform(p.target, p.source, p.rotation, p.translation_mm + rng.normal(scale=0.3, size=3))
        for p in seen
    ]
    robot = tracked(tip(robot_times), robot_times, "robot")
    sensor = tracked(noisy, sensor_times + 1e-3 * LAG_MS, "tracker")
    positions = TimedSignal.from_positions(sensor)
    with_rotations = estimate_time_offset(TimedSignal.from_poses(robot), positions)
    assert with_rotations.accepted, with_rotations.reason
    assert with_rotations.offset_ns / 1e6 == pytest.approx(LAG_MS, abs=0.5)
    positions_only = estimate_time_offset(TimedSignal.from_positions(robot), positions)
    assert positions_only.explained < with_rotations.explained


@pytest.mark.parametrize("flat", ["a", "b"])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_signal_without_motion_is_rejected(flat, noise):
    rng = np.random.default_rng(6)
    a, b = streams(rng)
    still = TimedSignal(a.times_ns, 250.0 + rng.normal(scale=noise, size=a.values.shape), "robot")
    with pytest.raises(FlatSignalError, match=f"signal {flat} .* does not move"):
        estimate_time_offset(*((still, b) if flat == "a" else (b, still)))


def test_uniform_motion_is_not_accepted():
    rng, times = np.random.default_rng(7), np.arange(1000) / 50.0
    ramp = np.outer(times, [3.0, 4.0])
    robot, tracker = ramp + rng.normal(scale=0.1, size=(2, 1000, 2))
    signals = (TimedSignal(in_ns(times), robot, "a"), TimedSignal(in_ns(times), tracker, "b"))
    assert not estimate_time_offset(*signals).accepted


def test_periodic_motion_is_ambiguous():
    times = np.arange(2000) / 100.0
    wave = np.sin(2.0 * np.pi * 2.5 * times)
    late = TimedSignal(in_ns(times + 0.065), wave, "tracker")
    result = estimate_time_offset(TimedSignal(in_ns(times), wave, "robot"), late)
    assert not result.accepted and "fits as well as" in result.reason


def test_offset_beyond_the_search_is_not_accepted():
    a, b = streams(np.random.default_rng(8))
    result = estimate_time_offset(a, b, search_s=0.04)
    assert not result.accepted and "end of the search" in result.reason


def test_unrelated_motions_are_not_accepted():
    a, _ = streams(np.random.default_rng(9), axes=1)
    _, b = streams(np.random.default_rng(10), axes=1)
    assert not estimate_time_offset(a, b).accepted


def test_invalid_signals_raise_specific_errors():
    times = np.arange(50) * 10**7
    values = np.sin(np.arange(50.0))
    repeated = np.where(np.arange(50) == 3, times[2], times)
    holed = np.where(np.arange(50) == 7, np.nan, values)
    for error, message, given in (
        (ShapeError, "integer ns", (times / 1e9, values)),
        (ShapeError, r"time 3 .* increasing", (repeated, values)),
        (UnequalCountsError, "50 times", (times, values[:-1])),
        (NotFiniteError, "value 7", (times, holed)),
    ):
        with pytest.raises(error, match=message):
            TimedSignal(*given, "robot")
    short = TimedSignal(times, values, "robot")
    with pytest.raises(TooFewError, match=r"0 samples of b are inside"):
        estimate_time_offset(short, short)
    with pytest.raises(ShapeError, match="search_s"):
        estimate_time_offset(*streams(np.random.default_rng(11)), search_s=0.0)
    pose = Transform.identity("reference", "tip")
    mixed = [TrackedTransform(pose, Stamp(i, f"clock{i}"), TrackingStatus.OK) for i in range(2)]
    with pytest.raises(StampError, match="several clocks"):
        TimedSignal.from_positions(mixed)


def test_signal_arrays_are_read_only_copies():
    times, values = np.arange(3) * 10**7, np.arange(3.0)
    signal = TimedSignal(times, values, "robot")
    times[0] = 5
    values[0] = 5.0
    assert signal.times_ns[0] == 0 and signal.values[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        signal.values[0, 0] = 1.0
