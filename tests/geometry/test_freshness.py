import pytest
from hypothesis import strategies as st

from app.geometry import (
    Freshness,
    FreshnessLimits,
    InputError,
    Stamp,
    StampError,
    freshness_of,
    freshness_of_stamp,
    stale_in_ns,
)
from tests.geometry.few_examples import given

NOW_NS = 1_700_000_000_000_000_000
LIMITS = FreshnessLimits(200, frozen_after_ns=1000)
TOLERANT = FreshnessLimits(200, future_tolerance_ns=5)


@pytest.mark.parametrize(
    ("age_ns", "freshness"),
    [
        (-(10**18), Freshness.FUTURE),
        (-1, Freshness.FUTURE),
        (0, Freshness.VALID),
        (1, Freshness.VALID),
        (200, Freshness.VALID),
        (201, Freshness.STALE),
        (10**18, Freshness.STALE),
    ],
)
def test_sample_is_valid_from_its_stamp_up_to_the_limit(age_ns, freshness):
    assert freshness_of(NOW_NS - age_ns, NOW_NS, LIMITS) is freshness
    assert freshness_of_stamp(Stamp(NOW_NS - age_ns), Stamp(NOW_NS), LIMITS) is freshness


def test_no_sample_is_missing():
    assert freshness_of(None, NOW_NS, LIMITS) is Freshness.MISSING
    assert freshness_of(None, NOW_NS, LIMITS, unchanged_ns=1001) is Freshness.MISSING
    assert freshness_of_stamp(None, Stamp(NOW_NS), LIMITS) is Freshness.MISSING


@pytest.mark.parametrize(
    ("unchanged_ns", "freshness"),
    [(0, Freshness.VALID), (1000, Freshness.VALID), (1001, Freshness.FROZEN)],
)
def test_sample_is_frozen_just_after_its_limit(unchanged_ns, freshness):
    assert freshness_of(NOW_NS, NOW_NS, LIMITS, unchanged_ns) is freshness
    assert freshness_of(NOW_NS, NOW_NS, TOLERANT, unchanged_ns) is Freshness.VALID


@pytest.mark.parametrize(("age_ns", "freshness"), [(-1, Freshness.FUTURE), (201, Freshness.STALE)])
def test_wrong_age_is_reported_before_frozen_values(age_ns, freshness):
    assert freshness_of(NOW_NS - age_ns, NOW_NS, LIMITS, unchanged_ns=1001) is freshness


@pytest.mark.parametrize(
    ("ahead_ns", "freshness"), [(1, Freshness.VALID), (5, Freshness.VALID), (6, Freshness.FUTURE)]
)
def test_tolerance_shifts_the_limit_of_the_future_alone(ahead_ns, freshness):
    assert freshness_of(NOW_NS + ahead_ns, NOW_NS, TOLERANT) is freshness
    assert freshness_of(NOW_NS - 201, NOW_NS, TOLERANT) is Freshness.STALE


@given(st.integers(-(10**19), 10**19), st.integers(0, 10**12), st.integers(0, 10**12))
def test_valid_is_exactly_the_closed_interval(age_ns, stale_after_ns, tolerance_ns):
    limits = FreshnessLimits(stale_after_ns, future_tolerance_ns=tolerance_ns)
    is_valid = freshness_of(NOW_NS - age_ns, NOW_NS, limits) is Freshness.VALID
    assert is_valid == (-tolerance_ns <= age_ns <= stale_after_ns)


@given(st.integers(0, 10**12), st.integers(0, 10**12))
def test_sample_is_stale_one_nanosecond_after_its_remaining_time(age_ns, stale_after_ns):
    limits = FreshnessLimits(stale_after_ns)
    left_ns = stale_in_ns(NOW_NS - age_ns, NOW_NS, limits)
    if left_ns >= 0:
        assert freshness_of(NOW_NS - age_ns, NOW_NS + left_ns, limits) is Freshness.VALID
    assert freshness_of(NOW_NS - age_ns, NOW_NS + left_ns + 1, limits) is Freshness.STALE


def test_stamps_of_two_clocks_are_not_compared():
    with pytest.raises(StampError, match="'robot' and 'tracker'"):
        freshness_of_stamp(Stamp(NOW_NS, "robot"), Stamp(NOW_NS, "tracker"), LIMITS)


@pytest.mark.parametrize("name", ["stale_after_ns", "frozen_after_ns", "future_tolerance_ns"])
def test_negative_limit_is_rejected(name):
    limits = {"stale_after_ns": 200, name: -1}
    with pytest.raises(InputError, match=f"^{name} is -1; expected 0 or more$"):
        FreshnessLimits(**limits)
