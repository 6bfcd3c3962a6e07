"""Which pages have the last picture."""

from app.viewer.drawing.client_acks import Pages

S = 1_000_000_000


def test_without_clients_nothing_is_pending():
    pages = Pages()
    pages.sent(1, 0)
    assert not pages.any_awake(0)
    assert not pages.waiting(0)


def test_picture_is_pending_until_every_client_acknowledges_it():
    pages = Pages()
    pages.has("a", 0, 0)
    pages.has("b", 0, 0)
    pages.sent(1, 0)
    assert pages.waiting(1)
    pages.has("a", 1, 2)
    assert pages.waiting(3)
    pages.has("b", 1, 4)
    assert not pages.waiting(5)


def test_client_silent_for_a_second_is_not_waited_for():
    pages = Pages()
    pages.has("asleep", 0, 0)
    pages.sent(1, S // 2)
    assert pages.waiting(S - 1)
    assert not pages.waiting(S + 1)
    assert not pages.any_awake(S + 1)


def test_lost_picture_is_pending_for_at_most_a_second():
    pages = Pages()
    pages.has("a", 0, 0)
    pages.sent(1, 0)
    for beat in range(1, 20):
        pages.has("a", 0, beat * S // 10)
    pages.has("a", 0, 2 * S)
    assert not pages.waiting(2 * S)


def test_new_client_has_nothing_pending():
    pages = Pages()
    pages.sent(7, 0)
    pages.has("new", 0, 1)
    assert pages.any_awake(2)
    assert not pages.waiting(2)
