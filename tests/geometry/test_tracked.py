"""Tracked transforms: agreement of transform, status and frames."""

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


def test_valid_sample_has_the_frames_of_its_transform():
    sample = TrackedTransform(Transform.identity("tracker", "stylus"), STAMP, TrackingStatus.OK)
    assert (sample.target, sample.source) == ("tracker", "stylus")


def test_valid_equals_the_constructor():
    pose = Transform.identity("tracker", "stylus")
    made, checked = TrackedTransform.valid(pose, STAMP), TrackedTransform(pose, STAMP, OK)
    for field in fields(TrackedTransform):
        assert getattr(made, field.name) == getattr(checked, field.name)
    with pytest.raises(FrozenInstanceError):
        made.stamp = Stamp(2)


@pytest.mark.parametrize("status", [status for status in TrackingStatus if status])
def test_lost_sample_keeps_its_frames_and_has_no_transform(status):
    sample = TrackedTransform.lost("tracker", "stylus", STAMP, status)
    assert sample.transform is None
    assert (sample.target, sample.source) == ("tracker", "stylus")
    with pytest.raises(TransformError, match="has a transform"):
        TrackedTransform(Transform.identity("tracker", "stylus"), STAMP, status)


def test_ok_sample_without_transform_is_rejected():
    with pytest.raises(TransformError, match="lacks its transform"):
        TrackedTransform.lost("tracker", "stylus", STAMP, TrackingStatus.OK)


def test_frames_that_contradict_the_transform_are_rejected():
    with pytest.raises(FrameError, match="'probe' contradicts the transform; expected 'stylus'"):
        TrackedTransform(
            Transform.identity("tracker", "stylus"), STAMP, TrackingStatus.OK, source="probe"
        )
    with pytest.raises(FrameError, match="not allowed"):
        TrackedTransform.lost("", "stylus", STAMP, TrackingStatus.INVALID)
