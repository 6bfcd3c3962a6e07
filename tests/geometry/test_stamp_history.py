"""Compare the history of stamps with a sorted list of all that was inserted."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import StampHistory

STAMPS = st.lists(st.integers(0, 40), min_size=1, max_size=60)


def history(**changes):
    limits = {"keep_ns": math.inf, "restart_ns": math.inf, "max_values": math.inf}
    return StampHistory(**(limits | changes))


@given(STAMPS, st.integers(-2, 42))
def test_values_around_a_stamp_are_the_nearest_ones(stamps, at):
    made = history()
    for stamp in stamps:
        made.insert(stamp, f"at {stamp}")
    below = [each for each in stamps if each <= at]
    above = [each for each in stamps if each >= at]
    found = made.around(at)
    if not below or not above:
        assert found is None
        return
    before, after, fraction = found
    assert (before, after) == (f"at {max(below)}", f"at {min(above)}")
    assert max(below) + fraction * (min(above) - max(below)) == pytest.approx(at)


@given(STAMPS, st.integers(1, 8), st.integers(1, 20), st.integers(1, 8))
def test_what_is_kept_depends_on_age_and_number(stamps, min_values, keep_ns, more):
    made = history(keep_ns=keep_ns, min_values=min_values, max_values=min_values + more)
    for stamp in sorted(stamps):
        made.insert(stamp, stamp)
    known = sorted(set(stamps))
    young = [each for each in known if each >= known[-1] - keep_ns]
    kept = known[-max(min(len(young), min_values + more), min_values) :]
    assert (made.oldest_ns, made.newest_ns) == (kept[0], kept[-1])


def test_history_is_limited_for_values_in_reverse_order():
    made = history(max_values=50)
    for stamp in range(10_000, 0, -1):
        made.insert(stamp, stamp)
    assert (made.oldest_ns, made.newest_ns) == (9_951, 10_000)


def test_many_outdated_values_do_not_change_the_order():
    made = history(keep_ns=10)
    for stamp in range(5_000):
        made.insert(stamp, stamp)
    assert made.oldest_ns == 4_989
    assert made.around(4_995) == (4_995, 4_995, 0.0)
    assert not made.insert(4_988, 0)


def test_value_of_a_known_stamp_is_merged():
    first, both = history(), history(merge=lambda known, value: known + value)
    for made in (first, both):
        assert made.insert(1, "a")
        assert not made.insert(1, "b")
    assert first.around(1) == ("a", "a", 0.0)
    assert both.around(1) == ("ab", "ab", 0.0)


def test_jump_back_starts_anew_and_is_counted():
    made = history(restart_ns=10)
    made.insert(100, "old")
    assert made.insert(90, "late")
    assert (made.oldest_ns, made.restarts) == (90, 0)
    assert made.insert(89, "new")
    assert (made.oldest_ns, made.newest_ns, made.restarts) == (89, 89, 1)
