"""Constraint stream: serialised bytes, repetition, expiry and faults."""

import math
import sys
import threading
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st
from marginguard_msgs.msg import FixtureConstraint, HalfSpace, StructureState
from rclpy.serialization import deserialize_message, serialize_message

from app.bridge.publishing.constraint_stream import ConstraintStream, RawConstraint
from app.hold import SeenHold
from tests.waiting import DEADLINE_S

pytestmark = pytest.mark.slow


class Sent:
    """Publisher that deserialises and stores the messages."""

    def __init__(self):
        self.messages = []
        self._changed = threading.Condition()

    def publish(self, raw):
        with self._changed:
            self.messages.append(deserialize_message(raw, FixtureConstraint))
            self._changed.notify_all()

    def wait_until(self, condition):
        with self._changed:
            assert self._changed.wait_for(lambda: condition(self.messages), DEADLINE_S)


def streaming(hz=None, **options):
    """A stream, and the publisher that stores its messages."""
    sent = Sent()
    return sent, ConstraintStream(sent, hz, **options)


def seconds():
    """Test double of a clock: 10 s, 11 s, ..."""
    times = count(10 * 10**9, 10**9)
    return lambda: next(times)


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
        structures=[StructureState(name="wall", signed_distance=0.02, lower_bound=0.019)],
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
def test_bytes_agree_with_rclpy(frame, planes, seq):
    message = constraint(frame, planes)
    raw = RawConstraint.of(message).numbered(seq)
    message.seq = seq
    assert deserialize_message(raw, FixtureConstraint) == message
    assert len(raw) == len(serialize_message(message))


def test_heartbeat_repeats_all_values_with_consecutive_seq():
    sent, stream = streaming(1000.0)
    stream.publish(constraint())
    sent.wait_until(lambda messages: len(messages) >= 20)
    stream.close()
    assert [message.seq for message in sent.messages] == list(range(len(sent.messages)))
    expected = constraint()
    expected.instance_id = stream.instance_id
    for message in sent.messages:
        expected.seq = message.seq
        assert message == expected
    assert stream.seq == len(sent.messages)


def latched():
    message = constraint()
    message.hold = True
    message.reasons = ["warning_distance", "latched"]
    return message


def faulty():
    message = latched()
    message.state = FixtureConstraint.UNKNOWN
    message.reasons = ["stale", "latched"]
    return message


def counted_bits(start=100):
    """Test double of a random source: consecutive numbers."""
    numbers = count(start)
    return lambda bits: next(numbers)


def test_instance_is_constant_and_differs_between_starts():
    sent, other = Sent(), Sent()
    stream, second = ConstraintStream(sent, None), ConstraintStream(other, None)
    stream.publish(constraint())
    stream.invalidate(faulty())
    stream.publish(constraint(), valid_ns=0)
    stream.hold("inactive")
    second.publish(constraint())
    assert {message.instance_id for message in sent.messages} == {stream.instance_id}
    assert other.messages[0].instance_id != stream.instance_id
    assert len(stream.instance_id) == 16


def test_nonce_is_new_with_each_fault_and_zero_without_a_latched_hold():
    sent, stream = streaming(random_bits=counted_bits())
    starting = constraint()
    starting.state, starting.hold, starting.reasons = FixtureConstraint.UNKNOWN, True, ["starting"]
    for message in (starting, constraint(), faulty(), faulty(), latched(), latched()):
        stream.publish(message)
    assert [message.rearm_nonce for message in sent.messages] == [0, 0, *[102] * 4]
    stream.publish(faulty())  # another fault of the same hold
    stream.publish(latched())
    assert [message.rearm_nonce for message in sent.messages[-2:]] == [103, 103]
    stream.publish(constraint())
    stream.publish(latched())  # a hold that the session began by itself
    assert [message.rearm_nonce for message in sent.messages[-2:]] == [0, 104]


def test_random_zero_is_never_a_nonce():
    sent, drawn = Sent(), iter([7, 0, 0, 5, 6])
    stream = ConstraintStream(sent, None, random_bits=lambda bits: next(drawn))
    stream.publish(latched())
    assert sent.messages[-1].rearm_nonce == 5


def test_spent_nonce_is_replaced_by_the_next_hold():
    sent, stream = streaming(random_bits=counted_bits())
    stream.publish(latched())
    nonce = stream.present().nonce
    stream.consume(SeenHold(0, nonce + 1))
    assert stream.present().nonce == nonce
    stream.consume(SeenHold(0, nonce))
    assert stream.present().nonce == 0
    stream.publish(latched())
    assert sent.messages[-1].rearm_nonce not in (0, nonce)


def test_nonce_of_the_stale_message_is_that_of_the_hold_that_follows():
    sent, stream = streaming(random_bits=counted_bits())
    stream.publish(latched())
    stream.publish(latched(), valid_ns=0)  # expires at once: the stale message is published
    stream.publish(latched())
    before, stale, after = (message.rearm_nonce for message in sent.messages)
    assert before != stale == after
    stream.publish(latched(), valid_ns=0)
    stream.invalidate(faulty())
    assert sent.messages[-1].rearm_nonce not in (before, stale, sent.messages[-2].rearm_nonce)


@pytest.mark.parametrize("before", [constraint, latched])
@pytest.mark.parametrize("following", [faulty, latched, constraint])
def test_hold_that_begins_stale_keeps_its_nonce_and_begin(before, following):
    sent, stream = streaming(random_bits=counted_bits(), clock_ns=seconds())
    stream.publish(before(), valid_ns=0)  # expires at once: the stale message is published
    assert not stream.publish(following())
    stream.publish(faulty())  # the session has latched the hold
    stream.publish(latched())
    stale, *after = sent.messages
    assert stale.hold
    assert stale.rearm_nonce != 0
    for message in after if following is faulty else after[:1]:
        assert (message.rearm_nonce, message.hold_since) == (stale.rearm_nonce, stale.hold_since)
    if following is not faulty:  # then the step that became UNKNOWN is another fault
        assert {message.rearm_nonce for message in after[1:]} & {stale.rearm_nonce} == set()
        assert {message.hold_since.sec for message in after} == {stale.hold_since.sec}


def test_spent_nonce_of_a_stale_message_is_not_used_again():
    sent, stream = streaming(random_bits=counted_bits())
    for _ in range(2):
        stream.publish(constraint(), valid_ns=0)
        stream.publish(faulty())
        stream.publish(latched())
        stream.consume(stream.present())
        stream.publish(constraint())
    stream.publish(constraint())
    stream.hold("inactive")
    stream.publish(faulty())
    holds = [message.rearm_nonce for message in sent.messages if message.hold]
    first, second, third = holds[:3], holds[3:6], holds[6:]
    assert [len(set(nonces)) for nonces in (first, second, third)] == [1, 1, 1]
    assert len({first[0], second[0], third[0], 0}) == 4


def test_last_message_after_a_stale_one_keeps_nonce_and_begin_of_the_hold():
    sent, stream = streaming(random_bits=counted_bits(), clock_ns=seconds())
    stream.publish(constraint(), valid_ns=0)
    stream.hold("inactive")
    stream.publish(faulty())
    assert [message.reasons[0] for message in sent.messages] == ["stale", "inactive", "stale"]
    assert len({(message.rearm_nonce, message.hold_since.sec) for message in sent.messages}) == 1


def test_hold_since_is_the_begin_of_the_hold():
    sent, stream = streaming(clock_ns=seconds())
    for message in (constraint(), latched(), faulty(), constraint(), latched()):
        stream.publish(message)
    assert [message.hold_since.sec for message in sent.messages] == [0, 10, 10, 0, 11]


def test_expired_constraint_is_repeated_as_stale_on_hold():
    sent, stream = streaming(1000.0)
    message = constraint()
    message.planes_current = True
    stream.publish(message, valid_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    stream.close()
    fresh = sent.messages[0]
    stale = next(message for message in sent.messages if message.hold)
    assert fresh.state == FixtureConstraint.WARNING
    assert (fresh.planes_current, stale.planes_current) == (True, False)
    assert (stale.state, list(stale.reasons)) == (FixtureConstraint.UNKNOWN, ["stale"])
    assert stale.header == fresh.header
    assert stale.valid_until == fresh.valid_until
    assert [plane.offset for plane in stale.half_spaces] == [0.5, 1.5]
    assert all(plane.tumor_velocity.x == 0.0 for plane in stale.half_spaces)
    assert math.isnan(stale.signed_distance)
    assert math.isnan(stale.lower_bound)
    (wall,) = stale.structures
    assert (wall.name, wall.state) == ("wall", FixtureConstraint.UNKNOWN)
    assert math.isnan(wall.signed_distance) and math.isnan(wall.lower_bound)


def test_constraint_after_a_stale_one_is_held_as_latched():
    sent, stream = streaming(1000.0)
    assert stream.publish(constraint(), valid_ns=10**12)
    assert not stream.ended
    assert stream.publish(constraint(), valid_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    assert stream.ended
    stale = next(message for message in sent.messages if message.hold)
    assert stream.fault_seq == stale.seq
    assert not stream.publish(constraint(), valid_ns=10**12)
    assert not stream.ended
    again = sent.messages[-1]
    assert (again.state, again.hold) == (FixtureConstraint.WARNING, True)
    assert list(again.reasons) == ["warning_distance", "latched"]
    assert stream.fault_seq == stale.seq  # acknowledging it is sufficient to re-arm
    # From here on the session holds.
    assert stream.publish(constraint(), valid_ns=10**12)
    stream.close()
    assert not sent.messages[-1].hold


def test_nonce_of_a_stale_message_does_not_cover_a_cause_that_comes_after_it():
    sent, stream = streaming(1000.0)
    assert stream.publish(constraint(), valid_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    stale = next(message for message in sent.messages if message.hold)
    late = constraint()
    late.state, late.hold = FixtureConstraint.UNKNOWN, True
    late.reasons, late.hold_causes = ["contradiction", "latched"], ["a contradiction"]
    assert not stream.publish(late, valid_ns=10**12)
    stream.close()
    seen = sent.messages[-1]
    assert seen.rearm_nonce not in (0, stale.rearm_nonce)
    assert stream.present().nonce == seen.rearm_nonce
    assert stream.fault_seq > stale.seq


def test_fault_after_a_stale_constraint_is_the_same_fault():
    sent, stream = streaming(1000.0)
    stream.publish(constraint(), valid_ns=5_000_000)
    sent.wait_until(lambda messages: messages[-1].hold)
    first = stream.fault_seq
    unknown = constraint()
    unknown.state = FixtureConstraint.UNKNOWN
    stream.publish(unknown)
    stream.publish(unknown)
    stream.close()
    assert stream.fault_seq == first


def test_constraint_after_hold_is_held():
    sent, stream = streaming(100.0)
    stream.publish(constraint())
    stream.hold("inactive")
    assert not stream.publish(constraint())
    assert sent.messages[-1].hold
    stream.close()


def test_hold_publishes_a_last_constraint_on_hold():
    sent, stream = streaming(1000.0)
    stream.publish(constraint())
    stream.hold("inactive")
    count = len(sent.messages)
    stream.hold("inactive")
    stream.close()
    last = sent.messages[-1]
    assert (last.state, last.hold, list(last.reasons)) == (3, True, ["inactive"])
    assert len(sent.messages) == count


def test_hold_before_the_first_constraint_publishes_nothing():
    sent, stream = streaming(1000.0)
    stream.hold("inactive")
    stream.close()
    assert sent.messages == []


def test_fault_seq_is_that_of_the_latest_fault():
    _, stream = streaming()
    unknown = constraint()
    unknown.state = FixtureConstraint.UNKNOWN
    found = []
    for message in (constraint(), unknown, unknown, constraint(), unknown):
        stream.publish(message)
        found.append(stream.fault_seq)
    stream.close()
    assert found == [0, 1, 1, 1, 4]


@pytest.mark.parametrize("hz", [None, 1000.0])
def test_close_restores_the_switch_interval(hz):
    before = sys.getswitchinterval()
    ConstraintStream(Sent(), hz).close()
    assert sys.getswitchinterval() == before


def test_last_of_two_fast_streams_restores_the_switch_interval():
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.003)
    try:
        first, second = ConstraintStream(Sent(), 1000.0), ConstraintStream(Sent(), 1000.0)
        first.close()
        assert sys.getswitchinterval() < 0.003
        second.close()
        assert sys.getswitchinterval() == 0.003
    finally:
        sys.setswitchinterval(before)


def test_invalidate_replaces_the_planes_and_is_a_new_fault():
    sent, stream = streaming(1000.0)
    unknown = FixtureConstraint(state=FixtureConstraint.UNKNOWN, hold=True)
    assert not stream.invalidate(unknown)  # nothing has been published yet
    # It is a new fault also after an earlier one that has been acknowledged.
    stream.publish(constraint())
    fault = constraint()
    fault.state = FixtureConstraint.UNKNOWN
    stream.publish(fault)
    acknowledged = stream.seq
    assert stream.invalidate(unknown)
    assert stream.fault_seq >= acknowledged
    sent.wait_until(lambda messages: len(messages[stream.fault_seq :]) >= 5)
    assert not any(message.half_spaces for message in sent.messages[stream.fault_seq :])
    assert stream.publish(constraint())
    assert sent.messages[-1].half_spaces
    stream.hold("inactive")
    assert not stream.invalidate(unknown)
    count = stream.seq
    stream.close()
    assert len(sent.messages) == count
    assert list(sent.messages[-1].reasons) == ["inactive"]
