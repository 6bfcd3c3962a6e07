"""Stamps: exact reading of seconds, comparison within one clock."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import Stamp, StampError


@given(st.integers(-(10**18), 9 * 10**18))
def test_decimal_seconds_are_read_exactly(ns):
    sign = "-" if ns < 0 else ""
    text = f"{sign}{abs(ns) // 10**9}.{abs(ns) % 10**9:09d}"
    assert Stamp.from_seconds(text).ns == ns


@pytest.mark.parametrize("text", ["280.4611428572264", " 1e-3 ", "-0", "5.2e-005"])
def test_seconds_are_rounded_to_the_nearest_nanosecond(text):
    assert abs(Fraction(Stamp.from_seconds(text).ns, 10**9) - Fraction(text.strip())) <= Fraction(
        1, 2 * 10**9
    )


@pytest.mark.parametrize(
    "text", ["", "now", "nan", "inf", "1.2.3", "1e30", "1e9999999", "1_0", "\u0661"]
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
    for compare in (
        lambda: robot.age_ns(tracker),
        lambda: robot < tracker,
        lambda: robot <= tracker,
    ):
        with pytest.raises(StampError, match="'robot' and 'tracker' cannot be compared"):
            compare()
    assert robot.shifted(7, "tracker") == Stamp(12, "tracker")
    with pytest.raises(StampError, match="clock of a stamp is empty"):
        Stamp(5, "")
