"""The pose of a probe at the stamp of an image, by the tracker's samples around it."""

import numpy as np
import pytest

from app.case import PoseHistory
from app.geometry import NS_PER_MS, Stamp, TrackedTransform, TrackingStatus, Transform

GAP_NS = 100 * NS_PER_MS


def sample(at_ms: float, x_mm: float, target: str = "tracker", source: str = "probe"):
    pose = Transform(target, source, np.eye(3), np.array([x_mm, 0.0, 0.0]))
    return TrackedTransform.valid(pose, Stamp(round(at_ms * NS_PER_MS)))


def lost(at_ms: float) -> TrackedTransform:
    status = TrackingStatus.OUT_OF_VIEW
    return TrackedTransform.lost("tracker", "probe", Stamp(round(at_ms * NS_PER_MS)), status)


def at(history: PoseHistory, ms: float, target: str = "tracker"):
    return history.matrix(round(ms * NS_PER_MS), target, "probe")


def test_pose_between_two_samples_is_interpolated():
    history = PoseHistory(GAP_NS)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    end = Transform("tracker", "probe", quarter, np.array([10.0, 0.0, 0.0]))
    history.add([sample(1000, 0.0), TrackedTransform.valid(end, Stamp(1_040 * NS_PER_MS))])
    half = np.sqrt(0.5)
    expected = [[half, -half, 0, 5], [half, half, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(at(history, 1020), expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(at(history, 1040), end.matrix)


def test_path_through_the_tracker_uses_each_edge_at_the_stamp():
    history = PoseHistory(GAP_NS)
    history.add([sample(1000, 0.0), sample(1050, 50.0)])
    history.add([sample(990, 3.0, source="reference"), sample(1030, 7.0, source="reference")])
    found = at(history, 1020, "reference")
    np.testing.assert_allclose(found[:3, 3], [20.0 - 6.0, 0, 0], rtol=0, atol=1e-9)
    assert history.reaches(1030 * NS_PER_MS, "reference", "probe")
    assert not history.reaches(1030 * NS_PER_MS + 1, "reference", "probe")


@pytest.mark.parametrize(
    ("samples", "at_ms", "problem"),
    [
        ([], 1000, "no pose connects 'tracker' with 'probe'"),
        ([sample(1000, 0)], 999, "no pose of tracker -> probe before the image"),
        ([sample(1000, 0)], 1030, "the newest pose of tracker -> probe is 30 ms before the image"),
        ([sample(1000, 0), lost(1040)], 1020, "tracker -> probe is OUT_OF_VIEW"),
        ([lost(1000), sample(1040, 0)], 1020, "tracker -> probe is OUT_OF_VIEW"),
        ([lost(1000)], 1000, "tracker -> probe is OUT_OF_VIEW"),
        (
            [sample(1000, 0), sample(1101, 0)],
            1020,
            "the poses of tracker -> probe around the image are 101 ms apart; expected at most "
            "100 ms",
        ),
        ([sample(1000, 0), sample(1000, 1)], 1000, "tracker -> probe is INVALID"),
    ],
)
def test_pose_that_is_not_known_has_a_reason(samples, at_ms, problem):
    history = PoseHistory(GAP_NS)
    history.add(samples)
    assert at(history, at_ms) == problem


def test_samples_that_come_late_are_put_in_order():
    history = PoseHistory(GAP_NS)
    history.add([sample(1040, 40.0), sample(1000, 0.0), sample(1020, 20.0)])
    np.testing.assert_allclose(at(history, 1010)[:3, 3], [10.0, 0, 0], rtol=0, atol=1e-9)


def test_old_samples_are_dropped_and_a_clock_that_was_set_back_starts_anew():
    history = PoseHistory(GAP_NS, keep_ns=1000 * NS_PER_MS)
    history.add([sample(10_000 + 20 * index, index) for index in range(1000)])
    assert at(history, 10_010) == "no pose of tracker -> probe before the image"
    assert not isinstance(at(history, 29_010), str)
    history.add([sample(5_000, 0.0), sample(5_020, 0.0)])
    assert not isinstance(at(history, 5_010), str)
    assert at(history, 29_010) == "the newest pose of tracker -> probe is 23990 ms before the image"
