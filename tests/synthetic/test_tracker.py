import numpy as np
import pytest

from app.geometry import Stamp, TrackedTransform, TrackingStatus, Transform
from app.synthetic.simulated_tracker import SimulatedTracker
from app.synthetic.tracker import Dropout, Jitter, reported
from app.synthetic.tracker_model import TrackerModel

TRUTH = Transform.from_rotation_vector(
    (0.4, -0.8, 0.3), (100.0, -50.0, 220.0), target="tracker", source="needle"
)


@pytest.fixture(scope="module")
def errors():
    tracker = SimulatedTracker(TrackerModel("white", 50.0, Jitter()), [11])
    measured = [tracker.measure("needle", TRUTH, 0.0) for _ in range(6000)]
    shifts = np.array([m.translation_mm - TRUTH.translation_mm for m in measured])
    turns = np.array(
        [(TRUTH.inverse() @ m.renamed(source="measured")).rotation_vector for m in measured]
    )
    return shifts, turns


def test_jitter_has_the_stated_rms_in_space(errors):
    shifts, turns = errors
    # The RMS of 6000 3-D errors has a standard error of 0.6 %; 3 % is five times that.
    assert np.sqrt((shifts**2).sum(axis=1).mean()) == pytest.approx(0.3, rel=0.03)
    assert np.degrees(np.sqrt((turns**2).sum(axis=1).mean())) == pytest.approx(0.3, rel=0.03)


def test_jitter_is_unbiased_and_the_same_on_every_axis(errors):
    for values in errors:
        spread = values.std(axis=0)
        assert (np.abs(values.mean(axis=0)) < 5.0 * spread / np.sqrt(len(values))).all()
        np.testing.assert_allclose(spread / spread.mean(), 1.0, atol=0.05)


def test_jitter_is_white(errors):
    shifts, _ = errors
    for axis in range(3):
        assert abs(np.corrcoef(shifts[:-1, axis], shifts[1:, axis])[0, 1]) < 0.065


def sample(frame):
    pose = Transform.identity("tracker", frame)
    return TrackedTransform(pose, Stamp(5_000_000_000), TrackingStatus.OK)


def test_an_invalid_sample_arrives_without_numbers():
    dropouts = (Dropout(("needle",), "invalid", 2.0, 3.0),)
    lost = reported(sample("needle"), dropouts, 2.5)
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
