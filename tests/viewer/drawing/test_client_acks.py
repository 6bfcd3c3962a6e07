"""Which clients have the last picture."""

from app.viewer.drawing.client_acks import ClientAcks

S = 1_000_000_000


def test_without_clients_nothing_is_pending():
    acks = ClientAcks()
    acks.sent(1, 0)
    assert not acks.any_active(0)
    assert not acks.is_pending(0)


def test_picture_is_pending_until_a_client_acknowledges_it():
    acks = ClientAcks()
    acks.acknowledge("a", 0, 0)
    acks.acknowledge("b", 0, 0)
    acks.sent(1, 0)
    assert acks.is_pending(1)
    assert acks.is_pending(3)
    acks.acknowledge("b", 1, 4)
    assert not acks.is_pending(5)


def test_client_silent_for_a_second_is_not_waited_for():
    acks = ClientAcks()
    acks.acknowledge("silent", 0, 0)
    acks.sent(1, S // 2)
    assert acks.is_pending(S - 1)
    assert not acks.is_pending(S + 1)
    assert not acks.any_active(S + 1)


def test_lost_picture_is_pending_for_at_most_a_second():
    acks = ClientAcks()
    acks.acknowledge("a", 0, 0)
    acks.sent(1, 0)
    for beat in range(1, 20):
        acks.acknowledge("a", 0, beat * S // 10)
    acks.acknowledge("a", 0, 2 * S)
    assert not acks.is_pending(2 * S)


def test_new_client_has_nothing_pending():
    acks = ClientAcks()
    acks.sent(7, 0)
    acks.acknowledge("new", 0, 1)
    assert acks.any_active(2)
    assert not acks.is_pending(2)
