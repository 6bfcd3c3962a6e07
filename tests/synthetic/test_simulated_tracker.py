"""The errors of a simulated tracker have the sizes and the correlation of its model."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from app.synthetic.simulated_tracker import Metal, SimulatedTracker
from app.synthetic.tracker_model import (
    AURORA,
    NO_JITTER,
    POLARIS,
    PRESETS,
    TRAKSTAR,
    WHITE,
    Distortion,
    Dropout,
    Jitter,
    TrackerModel,
    reported,
    tracker_preset,
)

pytestmark = pytest.mark.slow

TRUTH = Transform.from_rotation_vector(
    (0.4, -0.8, 0.3), (100.0, -50.0, 220.0), target="tracker", source="needle"
)
PERIOD_S = 0.02
SLOW = TrackerModel("slow", 50.0, NO_JITTER, slow=Jitter(0.3, 0.005), correlation_s=0.1)


def errors(model, times_s, frame="needle", seed=7):
    tracker = SimulatedTracker(model, [seed])
    poses = [tracker.measure(frame, TRUTH, t) for t in times_s]
    shifts = [pose.translation_mm - TRUTH.translation_mm for pose in poses]
    turns = Rotation.from_matrix(TRUTH.rotation.T @ np.array([pose.rotation for pose in poses]))
    return np.array(shifts), turns.as_rotvec()


@pytest.fixture(scope="module")
def slow_errors():
    return errors(SLOW, PERIOD_S * np.arange(5000))


def test_correlated_jitter_has_the_stated_rms(slow_errors):
    shifts, turns = slow_errors
    # 100 s hold some 500 independent values of each axis: a standard error of 2 % of the RMS.
    assert np.sqrt((shifts**2).sum(axis=1).mean()) == pytest.approx(0.3, rel=0.07)
    assert np.sqrt((turns**2).sum(axis=1).mean()) == pytest.approx(0.005, rel=0.07)


@pytest.mark.parametrize("lag", [1, 3, 5, 10])
def test_autocorrelation_falls_exponentially(slow_errors, lag):
    for values in slow_errors:
        found = (values[:-lag] * values[lag:]).mean() / (values**2).mean()
        assert found == pytest.approx(np.exp(-lag * PERIOD_S / 0.1), abs=0.06)


def test_correlation_depends_on_time_and_not_on_samples():
    times = np.cumsum(np.random.default_rng(1).choice([0.01, 0.09], size=4000))
    shifts, _ = errors(SLOW, times)
    gaps = np.diff(times)
    for gap in (0.01, 0.09):
        at = np.flatnonzero(np.isclose(gaps, gap))
        found = (shifts[at] * shifts[at + 1]).mean() / (shifts**2).mean()
        assert found == pytest.approx(np.exp(-gap / 0.1), abs=0.06)


def test_sensors_have_noise_of_their_own():
    tracker = SimulatedTracker(SLOW, [3])
    pairs = np.array(
        [
            [tracker.measure(frame, TRUTH, t).translation_mm for frame in ("needle", "cautery")]
            for t in PERIOD_S * np.arange(2000)
        ]
    )
    one, other = (pairs[:, i] - TRUTH.translation_mm for i in range(2))
    assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 0.15


def test_same_seed_gives_same_samples_and_times():
    def run(seed):
        tracker = SimulatedTracker(AURORA, [seed])
        readings = list(tracker.readings(5.0))
        poses = [tracker.measure("needle", TRUTH, r.acquired_ns / 1e9).matrix for r in readings]
        return readings, np.array(poses), [tracker.loses() for _ in range(5000)]

    one, same, other = run(1), run(1), run(2)
    assert one[0] == same[0] and (one[1] == same[1]).all() and one[2] == same[2]
    assert one[0] != other[0] and (one[1][0] != other[1][0]).any() and one[2] != other[2]


@pytest.mark.parametrize("model", [AURORA, POLARIS, TRAKSTAR])
def test_digits_are_those_of_the_device(model):
    tracker = SimulatedTracker(model, [5])
    for t in np.arange(200) / model.rate_hz:
        pose = tracker.measure("needle", TRUTH, t)
        steps = pose.translation_mm / model.position_quantum_mm
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
        assert TRUTH.distance_mm_to(pose) < 1.5


def test_positions_repeat_when_jitter_is_below_the_step():
    still = replace(
        WHITE, white=Jitter(0.05, 0.0), position_quantum_mm=0.5, rotation_digits="euler"
    )
    shifts, _ = errors(replace(still, rotation_quantum=1e-3), PERIOD_S * np.arange(500))
    assert (np.diff(shifts, axis=0) == 0.0).all(axis=1).mean() > 0.5


def test_intervals_and_stamps_have_the_stated_spread():
    model = replace(WHITE, period_sd_s=0.001, stamp_sd_s=0.002, latency_s=0.03, skipped=0.02)
    readings = list(SimulatedTracker(model, [9]).readings(100.0))
    acquired = np.array([r.acquired_ns for r in readings]) / 1e9
    stamps = np.array([r.stamp_ns for r in readings]) / 1e9
    assert np.diff(acquired).mean() == pytest.approx(0.02, rel=0.01)
    assert np.diff(acquired).std() == pytest.approx(0.001, rel=0.1)
    assert (stamps - acquired).mean() == pytest.approx(0.03, abs=0.0002)
    assert (stamps - acquired).std() == pytest.approx(0.002, rel=0.1)
    assert np.mean([r.skipped for r in readings]) == pytest.approx(0.02, abs=0.006)
    assert not readings[0].skipped


def test_stamps_rise_even_with_the_largest_spread():
    model = replace(WHITE, rate_hz=250.0, period_sd_s=0.02, stamp_sd_s=0.02)
    stamps = [r.stamp_ns for r in SimulatedTracker(model, [2]).readings(20.0)]
    assert np.diff(stamps).min() > 0


def test_distortion_grows_with_nearness_of_metal_and_is_smooth():
    model = TrackerModel("bent", 50.0, NO_JITTER, distortion=Distortion(2.0, 0.01, 60.0))
    tracker = SimulatedTracker(model, [1])

    def error(distance_mm):
        metal = Metal(np.array([-300.0, 0.0, 0.0]), np.array([300.0, 0.0, 0.0]))
        truth = Transform("tracker", "needle", np.eye(3), np.array([10.0, 0.0, distance_mm]))
        bent = tracker.measure("needle", truth, 0.0, metal)
        return truth.distance_mm_to(bent), truth.angle_to(bent)

    shifts, turns = np.array([error(d) for d in np.arange(20.0, 200.0, 1.0)]).T
    assert (np.diff(shifts) < 0.0).all() and (np.diff(turns) < 0.0).all()
    assert np.abs(np.diff(shifts, n=2)).max() < 0.005
    assert error(60.0) == pytest.approx((1.0, 0.005), rel=1e-3)
    assert error(1000.0)[0] < 1e-3


@pytest.mark.parametrize("turn", [(0.4, -0.8, 0.3), (3.1, 0.2, 0.0), (0.1, 3.0, 0.3), (0, 0, -3.1)])
def test_a_sample_is_bent_moved_and_rounded_in_this_order(turn):
    """The compiled errors beside the same steps with scipy, from the same streams of numbers."""
    model = replace(
        SLOW,
        white=Jitter(0.2, 0.003),
        distortion=Distortion(2.0, 0.02, 60.0),
        position_quantum_mm=0.01,
        rotation_digits="quaternion",
        rotation_quantum=1e-4,
    )
    metal = Metal(np.array([-80.0, 20.0, 30.0]), np.array([40.0, -50.0, 100.0]))
    truth = Transform.from_rotation_vector(turn, (30.0, -20.0, 140.0), target="t", source="s")
    found = SimulatedTracker(model, [6]).measure("s", truth, 0.0, metal)

    along, to_start = metal.end_mm - metal.start_mm, truth.translation_mm - metal.start_mm
    away = to_start - np.clip(to_start @ along / (along @ along), 0.0, 1.0) * along
    share, soft = model.distortion.share(np.linalg.norm(away)), np.hypot(np.linalg.norm(away), 1.0)
    axis = np.cross(along / np.linalg.norm(along), away / soft)
    rotation = Rotation.from_matrix(truth.rotation)
    rotation = Rotation.from_rotvec(0.02 * share * axis) * rotation
    position = truth.translation_mm + 2.0 * share * away / soft
    for jitter, stream in ((model.slow, [6, 1]), (model.white, [6])):
        error = np.random.default_rng(stream).standard_normal(6) / np.sqrt(3.0)
        position = position + jitter.position_rms_mm * error[:3]
        rotation = rotation * Rotation.from_rotvec(jitter.angle_rms_rad * error[3:])
    digits = rotation.as_quat(canonical=True).round(4)
    np.testing.assert_allclose(found.translation_mm, position.round(2), rtol=0.0, atol=1e-12)
    expected = Rotation.from_quat(digits).as_matrix()
    np.testing.assert_allclose(found.rotation, expected, rtol=0.0, atol=1e-12)


def test_tracker_without_distortion_ignores_metal():
    metal = Metal(np.zeros(3), np.array([100.0, -50.0, 200.0]))
    near, far = (SimulatedTracker(POLARIS, [4]) for _ in range(2))
    assert (
        near.measure("needle", TRUTH, 0.0, metal).matrix == far.measure("needle", TRUTH, 0.0).matrix
    ).all()


def test_presets_have_jitter_below_the_published_control_limits():
    for name, limit_mm in (("aurora", 0.33), ("polaris", 0.10)):
        model = tracker_preset(name)
        total = np.hypot(model.white.position_rms_mm, model.slow.position_rms_mm)
        assert limit_mm / 3.0 < total < limit_mm


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate_hz": 0.0}, r"rate_hz is 0; expected 1 to 250"),
        ({"lost": 0.5}, r"lost is 0.5; expected 0 to 0.02"),
        ({"correlation_s": float("nan")}, r"correlation_s is nan"),
        ({"white": Jitter(-1.0)}, r"white.position_rms_mm is -1; expected 0 to 5"),
    ],
)
def test_values_out_of_range_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(AURORA, **change)


def test_unknown_preset_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="expected white, aurora, trakstar, polaris"):
        tracker_preset("kinect")
    assert list(PRESETS) == ["white", "aurora", "trakstar", "polaris"]


@pytest.fixture(scope="module")
def white_errors():
    return errors(TrackerModel("white", 50.0, Jitter()), np.zeros(6000), seed=11)


def test_jitter_has_the_stated_rms_in_space(white_errors):
    shifts, turns = white_errors
    # The RMS of 6000 3-D white_errors has a standard error of 0.6 %; 3 % is five times that.
    assert np.sqrt((shifts**2).sum(axis=1).mean()) == pytest.approx(0.3, rel=0.03)
    assert np.degrees(np.sqrt((turns**2).sum(axis=1).mean())) == pytest.approx(0.3, rel=0.03)


def test_jitter_is_unbiased_and_the_same_on_every_axis(white_errors):
    for values in white_errors:
        spread = values.std(axis=0)
        assert (np.abs(values.mean(axis=0)) < 5.0 * spread / np.sqrt(len(values))).all()
        np.testing.assert_allclose(spread / spread.mean(), 1.0, atol=0.05)


def test_jitter_is_white(white_errors):
    shifts, _ = white_errors
    for axis in range(3):
        assert abs(np.corrcoef(shifts[:-1, axis], shifts[1:, axis])[0, 1]) < 0.065


def sample(frame):
    pose = Transform.identity("tracker", frame)
    return TrackedTransform(pose, Stamp(5_000_000_000), TrackingStatus.OK)


def test_an_invalid_sample_arrives_without_numbers():
    lost = reported(sample("needle"), (Dropout(("needle",), "invalid", 2.0, 3.0),), 2.5)
    assert lost is not None and lost.status is TrackingStatus.INVALID
    assert lost.transform is None and lost.stamp == Stamp(5_000_000_000)


def test_a_missing_sample_does_not_arrive():
    assert reported(sample("needle"), (Dropout(("needle",), "missing", 2.0, 3.0),), 2.0) is None


@pytest.mark.parametrize(
    ("frame", "time_s"), [("needle", 1.98), ("needle", 3.02), ("cautery", 2.5)]
)
def test_other_samples_arrive_as_they_are(frame, time_s):
    received = sample(frame)
    assert reported(received, (Dropout(("needle",), "missing", 2.0, 3.0),), time_s) is received
