"""Heartbeat: repetition, sequence numbers, expiry and errors."""

import threading

import pytest

from app.bridge.heartbeat import Heartbeat, steady_ns
from app.bridge.ros_errors import BridgeError
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


class Sent:
    def __init__(self, enough):
        self.pairs = []
        self.enough = threading.Event()
        self._count = enough

    def __call__(self, message, seq):
        self.pairs.append((message, seq))
        if len(self.pairs) >= self._count:
            self.enough.set()


def test_without_rate_each_message_is_sent_once():
    sent = Sent(2)
    heartbeat = Heartbeat(sent, None)
    heartbeat.update("a")
    heartbeat.update("b")
    heartbeat.close()
    assert sent.pairs == [("a", 0), ("b", 1)]


def test_newest_message_is_repeated_with_consecutive_seq():
    sent = Sent(20)
    heartbeat = Heartbeat(sent, 1000.0)
    heartbeat.update("a")
    assert sent.enough.wait(DEADLINE_S)
    heartbeat.update("b")
    heartbeat.close()
    assert [seq for _, seq in sent.pairs] == list(range(len(sent.pairs)))
    messages = [message for message, _ in sent.pairs]
    assert messages == sorted(messages)
    assert messages.count("a") >= 20


def test_nothing_is_sent_before_first_message_and_after_close():
    sent = Sent(1)
    heartbeat = Heartbeat(sent, 1000.0)
    assert not sent.enough.wait(0.02)
    heartbeat.update("a")
    heartbeat.close()
    count = len(sent.pairs)
    assert not [thread for thread in threading.enumerate() if thread.name == "heartbeat"]
    assert len(sent.pairs) == count


def test_message_is_counted_before_its_receiver_can_answer():
    counted = []
    heartbeat = Heartbeat(lambda message, seq: counted.append(heartbeat.seq - seq), None)
    for message in "abc":
        heartbeat.update(message)
    assert counted == [1, 1, 1]
    heartbeat.close()


def test_error_in_the_thread_is_raised_on_close():
    failed = threading.Event()

    def send(message, seq):
        if seq == 1:
            failed.set()
            raise RuntimeError("no such publisher")

    heartbeat = Heartbeat(send, 1000.0)
    heartbeat.update("a")
    assert failed.wait(DEADLINE_S)
    with pytest.raises(BridgeError, match="heartbeat ended: no such publisher"):
        heartbeat.close()


@pytest.mark.parametrize("hz", [0.0, -1.0, 1001.0, float("nan")])
def test_rate_out_of_range_is_refused(hz):
    with pytest.raises(BridgeError, match="heartbeat rate"):
        Heartbeat(print, hz)


class SimulatedClock:
    """Replaces the module ``time`` and the steady clock; only `sleep` advances it."""

    def __init__(self):
        self.now_ns = 0

    def steady_ns(self):
        return self.now_ns

    def sleep(self, seconds):
        self.now_ns += round(seconds * 1e9)


def test_late_beat_does_not_delay_the_next_beats(monkeypatch):
    clock = SimulatedClock()
    monkeypatch.setattr("app.bridge.heartbeat.time", clock)
    monkeypatch.setattr("app.bridge.heartbeat.steady_ns", clock.steady_ns)
    sent_ms = []
    enough = threading.Event()

    def send(message, seq):
        if threading.current_thread().name != "heartbeat" or enough.is_set():
            return
        sent_ms.append(clock.now_ns / 1e6)
        if len(sent_ms) == 3:
            clock.sleep(0.0045)
        if len(sent_ms) == 10:
            enough.set()

    heartbeat = Heartbeat(send, 1000.0)
    heartbeat.update("a")
    assert enough.wait(DEADLINE_S)
    heartbeat.close()
    assert heartbeat.missed == 0
    after_ms = [ms - sent_ms[0] for ms in sent_ms]
    assert after_ms == [0.0, 1.0, 2.0, 6.5, 6.5, 6.5, 6.5, 7.0, 8.0, 9.0]


def test_missed_beats_are_skipped_and_counted():
    sent = Sent(3)
    held, go_on = threading.Event(), threading.Event()

    def send(message, seq):
        sent(message, seq)
        if seq == 1:
            held.set()
            go_on.wait(DEADLINE_S)

    heartbeat = Heartbeat(send, 1000.0)
    heartbeat.update("a")
    assert held.wait(DEADLINE_S)
    # The beats that are due while one is blocked are missed.
    threading.Event().wait(0.05)
    go_on.set()
    assert sent.enough.wait(DEADLINE_S)
    heartbeat.close()
    assert heartbeat.missed >= 40
    assert [seq for _, seq in sent.pairs] == list(range(len(sent.pairs)))


def test_expired_message_is_replaced_and_reported():
    sent = Sent(1)
    heartbeat = Heartbeat(sent, None)
    heartbeat.update("a", valid_ns=10**12, replacement=lambda: "a is old")
    assert not heartbeat.ended
    assert heartbeat.update("b", valid_ns=0, replacement=lambda: "b is old", unless_ended=True) == 1
    assert heartbeat.ended
    assert heartbeat.ended_seq == 1
    assert heartbeat.update("c", unless_ended=True) is None
    assert heartbeat.update("d") == 2
    assert not heartbeat.ended
    heartbeat.pause("rest")
    assert heartbeat.update("e", unless_ended=True) is None
    heartbeat.close()
    assert sent.pairs == [("a", 0), ("b is old", 1), ("d", 2), ("rest", 3)]


def test_message_that_expired_before_it_was_sent_is_replaced_at_once():
    """A stop of the process between the measurement of the validity and the call."""
    sent = Sent(1)
    heartbeat = Heartbeat(sent, None)
    begin_ns = steady_ns() - 10**9
    heartbeat.update("a", valid_ns=5 * 10**8, since_ns=begin_ns, replacement=lambda: "a is old")
    assert heartbeat.ended
    heartbeat.update("b", valid_ns=10**12, since_ns=begin_ns, replacement=lambda: "b is old")
    assert not heartbeat.ended
    heartbeat.close()
    assert sent.pairs == [("a is old", 0), ("b", 1)]


def test_last_message_is_sent_after_an_error_in_the_thread():
    sent = []

    def send(message, seq):
        if seq == 1:
            raise RuntimeError("cannot publish")
        sent.append(message)

    heartbeat = Heartbeat(send, 1000.0)
    (beats,) = [thread for thread in threading.enumerate() if thread.name == "heartbeat"]
    heartbeat.update("a")
    beats.join()
    with pytest.raises(BridgeError, match="cannot publish"):
        heartbeat.pause("hold")
    assert sent == ["a", "hold"]
    heartbeat.close()
