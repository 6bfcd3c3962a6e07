"""Stamps, tracked transforms that agree with their frames and status, and setters of slots."""

import operator
from dataclasses import FrozenInstanceError, dataclass, fields
from fractions import Fraction

import pytest
from hypothesis import strategies as st

from app.geometry import (
    FrameError,
    Stamp,
    StampError,
    TrackedTransform,
    TrackingStatus,
    Transform,
    TransformError,
    slot_setters,
)
from tests.geometry.few_examples import given


@given(st.integers(-46 * 10**17, 46 * 10**17))
def test_decimal_seconds_are_read_exactly(ns):
    sign = "-" if ns < 0 else ""
    text = f"{sign}{abs(ns) // 10**9}.{abs(ns) % 10**9:09d}"
    assert Stamp.from_seconds(text).ns == ns


@pytest.mark.parametrize("text", ["280.4611428572264", " 1e-3 ", "-0", "5.2e-005"])
def test_seconds_are_rounded_to_the_nearest_nanosecond(text):
    off = Fraction(Stamp.from_seconds(text).ns, 10**9) - Fraction(text.strip())
    assert abs(off) <= Fraction(1, 2 * 10**9)


@pytest.mark.parametrize(
    "text", ["", "now", "nan", "inf", "1.2.3", "1e30", "-4.7e9", "1e9999999", "1_0", "\u0661"]
)
def test_invalid_seconds_are_rejected(text):
    with pytest.raises(StampError, match="not a finite number of seconds"):
        Stamp.from_seconds(text)


@pytest.mark.parametrize("ns", [1.0, True, "1", None])
def test_stamp_of_another_type_than_int_is_rejected(ns):
    with pytest.raises(StampError, match="expected int ns"):
        Stamp(ns)


def test_age_is_now_minus_stamp():
    assert Stamp(5).age_ns(Stamp(12)) == 7
    assert Stamp(12).age_ns(Stamp(5)) == -7
    assert Stamp(5) < Stamp(12) <= Stamp(12)


def test_stamps_of_two_clocks_compare_only_after_a_shift():
    robot, tracker = Stamp(5, "robot"), Stamp(5, "tracker")
    for compare in (Stamp.age_ns, operator.lt, operator.le):
        with pytest.raises(StampError, match="'robot' and 'tracker' cannot be compared"):
            compare(robot, tracker)
    assert robot.shifted(7, "tracker") == Stamp(12, "tracker")
    with pytest.raises(StampError, match="clock of a stamp is empty"):
        Stamp(5, "")


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
    pose = Transform.identity("tracker", "stylus")
    with pytest.raises(FrameError, match="'probe' contradicts the transform; expected 'stylus'"):
        TrackedTransform(pose, STAMP, OK, source="probe")
    with pytest.raises(FrameError, match="not allowed"):
        TrackedTransform.lost("", "stylus", STAMP, TrackingStatus.INVALID)


@dataclass(frozen=True, slots=True)
class Span:
    first: int
    last: int

    def __post_init__(self):
        if self.last < self.first:
            raise ValueError("backwards")


def test_setters_are_in_field_order_and_the_instance_stays_frozen():
    set_first, set_last = slot_setters(Span)
    made = object.__new__(Span)
    set_first(made, 3)
    set_last(made, 5)
    assert made == Span(3, 5)
    with pytest.raises(FrozenInstanceError):
        made.last = 6  # type: ignore[misc]


def test_instance_of_another_type_is_rejected():
    set_first, _ = slot_setters(Span)
    with pytest.raises(TypeError, match="Span"):
        set_first(object(), 3)
