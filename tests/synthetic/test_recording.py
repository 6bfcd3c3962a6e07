"""The recording of a simulation with an electromagnetic tracker, and what it says is lost."""

from itertools import pairwise

import numpy as np
import pytest

from app.geometry import NS_PER_S, TrackingStatus
from app.synthetic import CaseOptions, Recording, SimulatedTracker
from app.synthetic.case_options import CaseErrors, Encoders, offset_ns
from app.synthetic.simulation import FIRST_STAMP_NS, ROBOT_TO_TRACKER_OFFSET_NS, TRACKED_FRAMES

pytestmark = pytest.mark.slow

OPTIONS = CaseOptions.of_tracker("aurora").with_values(
    {"tracker.lost": 0.01, "tracker.stamp_sd_s": 0.002}
)
ENCODERS = Encoders(CaseErrors(encoder_step_rad=0.001), 6, np.random.default_rng(1))


@pytest.fixture(scope="module")
def recording(simulation):
    tracker = SimulatedTracker(OPTIONS.tracker, [1, 1])
    offset = offset_ns(ROBOT_TO_TRACKER_OFFSET_NS, OPTIONS)
    return Recording(simulation, tracker, encoders=ENCODERS, offset_ns=offset)


@pytest.fixture(scope="module")
def frames(recording):
    return list(recording.frames())


def test_frames_come_at_the_rate_with_irregular_stamps(frames, simulation):
    gaps = np.diff([frame.stamp.ns for frame in frames]) / NS_PER_S
    assert np.median(gaps) == pytest.approx(0.025, rel=0.02)
    usual = gaps[gaps < 0.0375]
    assert usual.min() > 0.0 and 0.002 < usual.std() < 0.004
    assert len(frames) == pytest.approx(simulation.duration_s * 40.0, rel=0.02)


def test_recorded_time_of_an_acquisition_is_that_of_its_stamp(recording, frames):
    # The mean over all frames: a single stamp has an error of its own.
    stamps = np.array([f.stamp.ns for f in frames])
    late = (stamps[0] - FIRST_STAMP_NS) / NS_PER_S
    assert recording.recorded_s(5.0) == pytest.approx(5.0 + 0.030 - late)
    assert abs(recording.recorded_s(5.0) - 5.0) < 0.01


def test_listed_dropouts_are_the_samples_that_are_lost(recording, frames):
    dropouts = recording.dropouts(0.075)
    first_ns = frames[0].stamp.ns
    for name in TRACKED_FRAMES:
        listed = [d for d in dropouts if d.frame == name]
        for frame in frames:
            time_s = (frame.stamp.ns - first_ns) / NS_PER_S
            status = {s.source: s.status for s in frame.poses}.get(name)
            invalid = any(d.kind == "invalid" and d.start_s <= time_s <= d.end_s for d in listed)
            missing = any(d.kind == "missing" and d.start_s < time_s <= d.end_s for d in listed)
            assert (status is TrackingStatus.INVALID) == invalid
            assert status is not None or missing
    # One of 100 samples is lost by chance; each is a dropout of its own, as it is known at once.
    by_chance = [d for d in dropouts if d.kind == "invalid" and d.start_s == d.end_s]
    assert len(by_chance) == pytest.approx(0.01 * 3 * len(frames), rel=0.35)


def test_some_frames_repeat_the_one_before(frames):
    def pose(frame):
        return {s.source: s.transform.matrix for s in frame.poses if s.transform is not None}

    repeats = sum(
        set(pose(one)) == set(pose(two)) != set()
        and all((pose(one)[name] == pose(two)[name]).all() for name in pose(one))
        for one, two in pairwise(frames)
    )
    assert 2 <= repeats <= 40


def test_joints_have_the_steps_of_the_encoders(frames):
    positions = np.array([s.positions for frame in frames[:200] for s in frame.joints])
    np.testing.assert_allclose(positions, np.round(positions / 0.001) * 0.001, atol=1e-9)


def test_poses_differ_from_the_truth_by_noise_and_distortion(frames, simulation):
    off = []
    for frame in frames[::5]:
        time_s = (frame.stamp.ns - FIRST_STAMP_NS) / NS_PER_S - 0.030
        for sample in frame.poses:
            if sample.source == "reference" and sample.transform is not None:
                truth = simulation.tracker_from("reference", time_s)
                off.append(sample.transform.distance_mm_to(truth))
    assert 0.12 < np.sqrt(np.mean(np.square(off))) < 0.4
