"""`TfListener` with publishers of rclpy, within a process and between processes."""

import json
import signal
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from app.bridge import topics
from app.bridge.ros_errors import TfError
from app.bridge.tf import TransformBuffer
from app.bridge.tf_poses import TfSample, write_tf_message
from app.bridge.tf_topics import TfListener, tf_message
from app.bridge.topics import LATCHED, STREAM, Topic
from app.geometry import Stamp, Transform
from tests.waiting import DEADLINE_S, wait_until

pytestmark = pytest.mark.slow

SENDER = Path(__file__).parent / "sender.py"


def shifted(child, x_mm, parent="world"):
    return Transform(parent, child, np.eye(3), np.array([x_mm, 0.0, 0.0]))


def looked_up(buffer, *edge):
    """The lookup, as soon as there is one."""

    def found():
        with suppress(TfError):
            return buffer.lookup(*edge)

    return wait_until(found)


def test_broadcast_transform_keeps_its_stamp(ros, other):
    buffer = TransformBuffer()
    TfListener(ros, buffer)
    latched = [shifted("base", 10.0), shifted("tip", 5.0, "tool")]
    other.publisher(topics.TF_STATIC).publish(tf_message((each, Stamp(0)) for each in latched))
    moving = other.publisher(topics.TF)
    assert other.wait_for_subscribers(topics.TF, 1, DEADLINE_S)
    moving.publish(tf_message([(shifted("tool", 66.0, "base"), Stamp(12_345_678_901))]))
    found = looked_up(buffer, "world", "tip")
    assert found.stamp_ns == 12_345_678_901
    assert found.transform.translation_mm == pytest.approx([81.0, 0.0, 0.0])


def test_late_listener_gets_every_latched_transform(ros, other):
    first = other.publisher(topics.TF_STATIC)
    second = other.publisher(Topic(topics.TF_STATIC.name, topics.TF_STATIC.type, LATCHED))
    first.publish(tf_message([(shifted("a", 3.0), Stamp(0)), (shifted("b", 2.0), Stamp(0))]))
    second.publish(tf_message([(shifted("c", 4.0), Stamp(0))]))
    buffer = TransformBuffer()
    TfListener(ros, buffer)
    for frame, x_mm in (("a", 3.0), ("b", 2.0), ("c", 4.0)):
        found = looked_up(buffer, "world", frame)
        assert found.transform.translation_mm[0] == pytest.approx(x_mm)


def test_invalid_samples_are_counted_and_the_rest_inserted(ros, other):
    buffer = TransformBuffer()
    listener = TfListener(ros, buffer)
    publisher = other.publisher(topics.TF)
    assert other.wait_for_subscribers(topics.TF, 1, DEADLINE_S)
    identity = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    publisher.publish(
        write_tf_message(
            [
                TfSample("world", "nan", 1, (np.nan, *identity[1:])),
                TfSample("world", "world", 1, identity),
                TfSample("world", "a", 1, identity),
                TfSample("a", "world", 1, identity),
                TfSample("/world", "b", 1, identity),
                TfSample("world", "long", 1, (*identity[:6], 3.0)),
                TfSample("world", "good", 1, identity),
            ]
        )
    )
    looked_up(buffer, "world", "good")
    assert listener.refused == {"TfInvalidError": 3, "TfConnectivityError": 1, "FrameError": 1}
    assert "norm 3" in listener.last_refusal
    assert buffer.frames == {"world", "a", "good"}


def test_oversized_message_is_refused_unread(ros, other):
    buffer = TransformBuffer()
    listener = TfListener(ros, buffer)
    publisher = other.publisher(topics.TF)
    assert other.wait_for_subscribers(topics.TF, 1, DEADLINE_S)
    identity = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    publisher.publish(write_tf_message([TfSample("w" * 10_000_000, "a", 1, identity)]))
    publisher.publish(write_tf_message([TfSample("world", "a", 1, identity)]))
    looked_up(buffer, "world", "a")
    assert listener.refused == {"TooLong": 1}
    assert buffer.frames == {"world", "a"}


def test_clock_jump_back_clears_the_buffer(ros, other):
    buffer = TransformBuffer()
    taken = threading.Event()
    TfListener(ros, buffer, received=taken.set)
    moving = other.publisher(topics.TF)
    clock_topic = Topic(topics.CLOCK.name, Clock, STREAM)
    clock = other.publisher(clock_topic)
    assert other.wait_for_subscribers(topics.TF, 1, DEADLINE_S)
    assert other.wait_for_subscribers(clock_topic, 1, DEADLINE_S)
    moving.publish(tf_message([(shifted("a", 1.0), Stamp(50))]))
    assert taken.wait(DEADLINE_S)
    jumped = threading.Event()
    set_now = buffer.set_now

    def observed_set_now(now_ns):
        if set_now(now_ns):
            jumped.set()

    buffer.set_now = observed_set_now
    for second in (5, 4):
        message = Clock()
        message.clock.sec = second
        clock.publish(serialize_message(message))
    assert jumped.wait(DEADLINE_S)
    assert buffer.parent("a") is None


def test_restarted_sender_is_received_again(ros, start):
    buffer = TransformBuffer()
    TfListener(ros, buffer)
    for stamp_ns in (7_000_000_000, 3_000_000_000):
        sender = start(SENDER, json.dumps(["world", "tool", stamp_ns]))
        found = looked_up(buffer, "world", "tool", stamp_ns)
        assert found.stamp_ns == stamp_ns
        sender.end(signal.SIGKILL)


def test_exception_in_a_callback_does_not_stop_the_node(ros, other):
    buffer = TransformBuffer()
    fails = iter([True])
    second = threading.Event()

    def received():
        if next(fails, False):
            raise RuntimeError("callback failed")
        second.set()

    TfListener(ros, buffer, received=received)
    moving = other.publisher(topics.TF)
    assert other.wait_for_subscribers(topics.TF, 1, DEADLINE_S)
    for number in (1, 2):
        moving.publish(tf_message([(shifted("a", float(number)), Stamp(number))]))
    assert second.wait(DEADLINE_S)
    assert ros.failures == 1
