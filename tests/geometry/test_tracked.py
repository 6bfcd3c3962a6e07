import pytest

from app.geometry import (
    FrameError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
)

STAMP = Stamp(1)


def test_a_good_sample_has_its_transforms_frames():
    sample = TrackedTransform(Transform.identity("tracker", "stylus"), STAMP, TrackingStatus.OK)
    assert (sample.target, sample.source) == ("tracker", "stylus")


@pytest.mark.parametrize("status", [status for status in TrackingStatus if status])
def test_a_lost_sample_keeps_its_frames_and_holds_no_number(status):
    sample = TrackedTransform.lost("tracker", "stylus", STAMP, status)
    assert sample.transform is None
    assert (sample.target, sample.source) == ("tracker", "stylus")
    with pytest.raises(TransformError, match="has a transform"):
        TrackedTransform(Transform.identity("tracker", "stylus"), STAMP, status)


def test_a_good_sample_without_a_pose_is_refused():
    with pytest.raises(TransformError, match="lacks its transform"):
        TrackedTransform.lost("tracker", "stylus", STAMP, TrackingStatus.OK)


def test_frames_that_contradict_the_transform_are_refused():
    with pytest.raises(FrameError, match="'probe' is not the transform's 'stylus'"):
        TrackedTransform(
            Transform.identity("tracker", "stylus"), STAMP, TrackingStatus.OK, source="probe"
        )
    with pytest.raises(FrameError, match="not allowed"):
        TrackedTransform.lost("", "stylus", STAMP, TrackingStatus.INVALID)
