"""The stream's bytes are rclpy's own, numbered; what it repeats ends when its data do."""

import math
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st
from marginguard_msgs.msg import FixtureConstraint, HalfSpace
from rclpy.serialization import deserialize_message, serialize_message

from app.bridge.control.constraint_stream import ConstraintStream, RawConstraint


class Sent:
    """A publisher that reads what it is given, and tells when enough has come."""

    def __init__(self):
        self.messages = []
        self._changed = threading.Condition()

    def publish(self, raw):
        with self._changed:
            self.messages.append(deserialize_message(raw, FixtureConstraint))
            self._changed.notify_all()

    def wait_until(self, seen):
        with self._changed:
            assert self._changed.wait_for(lambda: seen(self.messages), 30.0)


def constraint(frame="tumor", planes=2):
    message = FixtureConstraint(
        state=FixtureConstraint.WARNING,
        reasons=["warning_distance"],
        half_spaces=[HalfSpace(offset=0.5 + k) for k in range(planes)],
        signed_distance=0.004,
        lower_bound=0.0039,
        stop_distance=0.001,
        warn_distance=0.005,
        sigma_tre=0.0002,
        model_id="sha256:1",
    )
    for plane in message.half_spaces:
        plane.normal.z = 1.0
        plane.tumor_velocity.x = 0.02
    message.header.frame_id = frame
    message.header.stamp.sec = 17
    message.valid_until.sec = 18
    return message


@given(
    frame=st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=40),
    planes=st.integers(0, 3),
    seq=st.integers(0, 2**64 - 1),
)
def test_the_bytes_are_those_of_rclpy(frame, planes, seq):
    message = constraint(frame, planes)
    raw = RawConstraint.of(message).numbered(seq)
    message.seq = seq
    assert deserialize_message(raw, FixtureConstraint) == message
    assert len(raw) == len(serialize_message(message))


def test_beats_repeat_every_value_and_count_without_a_gap():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    stream.newest(constraint())
    sent.wait_until(lambda messages: len(messages) >= 20)
    stream.close()
    assert [message.seq for message in sent.messages] == list(range(len(sent.messages)))
    wanted = constraint()
    for message in sent.messages:
        wanted.seq = message.seq
        assert message == wanted
    assert stream.seq == len(sent.messages)


def test_a_repeated_constraint_says_stale_and_holds_when_its_data_are_too_old():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    stream.newest(constraint(), lasts_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    stream.close()
    fresh = sent.messages[0]
    stale = next(message for message in sent.messages if message.hold)
    assert fresh.state == FixtureConstraint.WARNING
    assert (stale.state, list(stale.reasons)) == (FixtureConstraint.UNKNOWN, ["stale"])
    assert stale.header == fresh.header
    assert stale.valid_until == fresh.valid_until
    assert [plane.offset for plane in stale.half_spaces] == [0.5, 1.5]
    assert all(plane.tumor_velocity.x == 0.0 for plane in stale.half_spaces)
    assert math.isnan(stale.signed_distance)
    assert math.isnan(stale.lower_bound)


def test_what_was_stale_is_held_also_when_it_is_fresh_again():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    assert stream.newest(constraint(), lasts_ns=5_000_000)
    assert not stream.ended
    sent.wait_until(lambda messages: messages[-1].hold)
    assert stream.ended
    stale = next(message for message in sent.messages if message.hold)
    assert stream.fault_seq == stale.seq
    assert not stream.newest(constraint(), lasts_ns=10**12)
    assert not stream.ended
    again = sent.messages[-1]
    assert (again.state, again.hold) == (FixtureConstraint.WARNING, True)
    assert list(again.reasons) == ["warning_distance", "latched"]
    assert stream.fault_seq == stale.seq  # whoever looked at it may re-arm
    # From here on it is for the session to hold.
    assert stream.newest(constraint(), lasts_ns=10**12)
    stream.close()
    assert not sent.messages[-1].hold


def test_a_fault_that_follows_a_stale_constraint_is_the_same_fault():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    stream.newest(constraint(), lasts_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    first = stream.fault_seq
    unknown = constraint()
    unknown.state = FixtureConstraint.UNKNOWN
    stream.newest(unknown)
    stream.newest(unknown)
    stream.close()
    assert stream.fault_seq == first


def test_after_a_rest_it_is_held():
    sent = Sent()
    stream = ConstraintStream(sent, 100.0)
    stream.newest(constraint())
    stream.rest("inactive")
    assert not stream.newest(constraint())
    assert sent.messages[-1].hold
    stream.close()


def test_data_that_are_too_old_from_the_first_are_never_sent_as_fresh():
    sent = Sent()
    stream = ConstraintStream(sent, None)
    stream.newest(constraint(), lasts_ns=0)
    stream.close()
    assert [message.hold for message in sent.messages] == [True]


def test_without_a_rate_each_is_sent_once_and_nothing_expires():
    sent = Sent()
    stream = ConstraintStream(sent, None)
    stream.newest(constraint())
    stream.newest(constraint())
    stream.close()
    assert [message.seq for message in sent.messages] == [0, 1]


def test_the_last_word_before_silence_is_hold():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    stream.newest(constraint())
    stream.rest("inactive")
    count = len(sent.messages)
    stream.rest("inactive")
    stream.close()
    last = sent.messages[-1]
    assert (last.state, last.hold, list(last.reasons)) == (3, True, ["inactive"])
    assert len(sent.messages) == count


def test_nothing_was_said_before_the_first_constraint():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    stream.rest("inactive")
    stream.close()
    assert sent.messages == []


def test_the_latest_fault_is_known_by_its_number():
    sent = Sent()
    stream = ConstraintStream(sent, None)
    unknown = constraint()
    unknown.state = FixtureConstraint.UNKNOWN
    found = []
    for message in (constraint(), unknown, unknown, constraint(), unknown):
        stream.newest(message)
        found.append(stream.fault_seq)
    stream.close()
    assert found == [0, 1, 1, 1, 4]


@pytest.mark.parametrize("hz", [None, 1000.0])
def test_the_interpreter_takes_turns_as_before_after_closing(hz):
    before = sys.getswitchinterval()
    ConstraintStream(Sent(), hz).close()
    assert sys.getswitchinterval() == before


def test_planes_that_mean_nothing_any_more_are_not_repeated_and_are_a_fault_of_their_own():
    sent = Sent()
    stream = ConstraintStream(sent, 1000.0)
    unknown = FixtureConstraint(state=FixtureConstraint.UNKNOWN, hold=True)
    assert not stream.forget(unknown)  # nothing was said yet
    # Also where there was a fault before, which somebody has looked at since.
    stream.newest(constraint())
    fault = constraint()
    fault.state = FixtureConstraint.UNKNOWN
    stream.newest(fault)
    looked_at = stream.seq
    assert stream.forget(unknown)
    assert stream.fault_seq >= looked_at
    sent.wait_until(lambda messages: len(messages[stream.fault_seq :]) >= 5)
    assert not any(message.half_spaces for message in sent.messages[stream.fault_seq :])
    assert stream.newest(constraint())
    assert sent.messages[-1].half_spaces
    stream.rest("inactive")
    assert not stream.forget(unknown)
    count = stream.seq
    stream.close()
    assert len(sent.messages) == count
    assert list(sent.messages[-1].reasons) == ["inactive"]
