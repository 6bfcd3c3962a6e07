"""The limit on a rate."""

from app.runtime.requests import RateLimit

S = 1_000_000_000


def test_burst_is_allowed_and_then_the_rate():
    limit = RateLimit(per_s=2.0, burst=3.0)
    assert [limit.take(0) for _ in range(4)] == [True, True, True, False]
    assert not limit.take(S // 4)
    assert limit.take(S // 2)
    assert not limit.take(S // 2)
    assert [limit.take(60 * S) for _ in range(4)] == [True, True, True, False]


def test_costly_use_takes_more_and_a_refused_one_takes_nothing():
    limit = RateLimit(per_s=1.0, burst=10.0)
    assert limit.take(0, 8.0)
    assert not limit.take(0, 8.0)
    assert limit.has(0, 2.0)
    assert limit.take(0, 2.0)


def test_clock_that_stands_or_jumps_back_gives_nothing():
    limit = RateLimit(per_s=1.0, burst=1.0)
    assert limit.take(5 * S)
    assert not limit.take(0)
    assert not limit.take(0)
