import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.geometry import NS_PER_S, Stamp
from app.session.live_clock import DRIFT, SourceClock

HOURS_NS = 3600 * NS_PER_S


def test_a_clock_of_the_host_is_the_hosts():
    clock = SourceClock(stamps_of_host=True)
    clock.arrived(5, 1000)
    clock.restart()
    assert clock.now(1234) == Stamp(1234)
    assert clock.host_time_for(7) == 7


def test_before_the_first_sample_the_time_is_not_known():
    clock = SourceClock(stamps_of_host=False)
    assert clock.now(1000) is None
    clock.arrived(5, 1000)
    assert clock.now(1000) == Stamp(5)
    clock.restart()
    assert clock.now(1000) is None


@given(
    st.lists(st.tuples(st.integers(1, NS_PER_S), st.integers(0, NS_PER_S)), min_size=1),
    st.integers(-HOURS_NS, HOURS_NS),
    st.floats(-0.9 * DRIFT, 0.9 * DRIFT),
)
def test_ages_are_short_by_the_fastest_way_at_most(samples, offset_ns, skew):
    """A source whose clock runs wrong by no more than crystals do; each sample has its own way."""
    clock = SourceClock(stamps_of_host=False)
    host_ns = 0
    fastest_ns = None
    for period_ns, way_ns in samples:
        host_ns += period_ns

        def source_ns(at_ns):
            return round(at_ns * (1.0 + skew)) + offset_ns

        stamp_ns = source_ns(host_ns - way_ns)
        clock.arrived(stamp_ns, host_ns)
        fastest_ns = way_ns if fastest_ns is None else min(fastest_ns, way_ns)
        age_ns = clock.now(host_ns).ns - stamp_ns
        assert age_ns >= 0
        # The true age, less what no clock on one side can see, and less the drift allowed for.
        slack_ns = 2 * DRIFT * host_ns + 10
        assert age_ns >= way_ns * (1.0 - DRIFT) - fastest_ns - slack_ns
        assert age_ns <= way_ns * (1.0 + DRIFT) + slack_ns


def test_a_way_that_becomes_longer_is_age_and_not_offset():
    clock = SourceClock(stamps_of_host=False)
    for second in range(60):
        clock.arrived(second * NS_PER_S, second * NS_PER_S + 1_000_000)
    late_ns = 60 * NS_PER_S + 101_000_000
    clock.arrived(60 * NS_PER_S, late_ns)
    age_ns = clock.now(late_ns).ns - 60 * NS_PER_S
    assert age_ns == pytest.approx(100_000_000, abs=2 * DRIFT * NS_PER_S)
