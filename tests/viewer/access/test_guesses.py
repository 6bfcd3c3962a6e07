"""Wrong tokens are counted for each address."""

import pytest

from app.viewer.access.guesses import GUESSES, GuessLimit

S = 1_000_000_000


@pytest.mark.parametrize(
    ("guessing", "same", "other"),
    [
        ("192.0.2.1", "192.0.2.1", "192.0.2.2"),
        ("2001:db8::1", "2001:db8::ffff:2", "2001:db8:0:1::1"),
        (None, None, "192.0.2.2"),
    ],
)
def test_address_is_blocked_after_its_guesses_and_free_again_later(guessing, same, other):
    limit = GuessLimit()
    assert all(limit.wrong(guessing, 0) for _ in range(GUESSES))
    assert not limit.wrong(guessing, 0)
    assert limit.is_blocked(same, 0)
    assert not limit.is_blocked(other, 0)
    assert limit.is_blocked(same, 5 * S)
    assert not limit.is_blocked(same, 7 * S)


def test_number_of_addresses_that_are_remembered_is_limited():
    limit = GuessLimit()
    for number in range(5000):
        limit.wrong(f"10.0.{number // 256}.{number % 256}", 0)
    assert len(limit._limits) == 1024
