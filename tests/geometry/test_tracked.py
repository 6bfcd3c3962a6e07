from dataclasses import FrozenInstanceError, fields

import pytest

from app.geometry import (
    FrameError,
    Stamp,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
)

STAMP, OK = Stamp(1), TrackingStatus.OK


def test_a_good_sample_has_its_transforms_frames():
    sample = TrackedTransform(Transform.identity("tracker", "stylus"), STAMP, TrackingStatus.OK)
    assert (sample.target, sample.source) == ("tracker", "stylus")


def test_a_sample_that_is_known_to_be_good_is_what_the_constructor_makes_of_it():
    pose = Transform.identity("tracker", "stylus")
    made, checked = TrackedTransform.good(pose, STAMP), TrackedTransform(pose, STAMP, OK)
    for field in fields(TrackedTransform):
        assert getattr(made, field.name) == getattr(checked, field.name)
    with pytest.raises(FrozenInstanceError):
        made.stamp = Stamp(2)


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
