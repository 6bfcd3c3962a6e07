"""Reading and writing of tf messages as CDR, compared with rclpy."""

import pytest
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from app.bridge.ros_errors import TfInvalidError
from app.bridge.tf_poses import TfMessageReader, TfSample, write_tf_message

pytestmark = pytest.mark.slow

names = st.text(st.characters(min_codepoint=33, max_codepoint=0x2FF), max_size=40)
numbers = st.floats(-1e6, 1e6, width=64)
samples = st.lists(
    st.builds(
        TfSample,
        names,
        names,
        st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1),
        st.tuples(*[numbers] * 7),
    ),
    max_size=5,
)


def by_rclpy(samples):
    message = TFMessage()
    for parent, child, stamp_ns, (x, y, z, p, q, r, s) in samples:
        each = TransformStamped(header=Header(frame_id=parent), child_frame_id=child)
        each.header.stamp.sec, each.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        each.transform.translation = Vector3(x=x / 1000.0, y=y / 1000.0, z=z / 1000.0)
        each.transform.rotation = Quaternion(x=p, y=q, z=r, w=s)
        message.transforms.append(each)
    return message


@settings(max_examples=60)
@given(samples)
def test_messages_written_by_rclpy_are_read(given_samples):
    read = TfMessageReader()(serialize_message(by_rclpy(given_samples)))
    assert [sample[:3] for sample in read] == [sample[:3] for sample in given_samples]
    for sample, expected in zip(read, given_samples, strict=True):
        assert sample.pose == pytest.approx(expected.pose, rel=1e-12, abs=1e-12)


@settings(max_examples=60)
@given(samples)
def test_written_messages_are_read_by_rclpy(given_samples):
    assert deserialize_message(write_tf_message(given_samples), TFMessage) == by_rclpy(
        given_samples
    )


def test_big_endian_message_is_read():
    sample = TfSample("a", "b", 3, (1000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    big = (
        b"\x00\x00\x00\x00" + b"\x00\x00\x00\x01" + bytes(4) + b"\x00\x00\x00\x03"
        b"\x00\x00\x00\x02a\x00\x00\x00\x00\x00\x00\x02b"
        + bytes(7)
        + b"\x3f\xf0"
        + bytes(46)
        + b"\x3f\xf0"
        + bytes(6)
    )
    assert len(big) == len(write_tf_message([sample]))
    assert TfMessageReader()(big) == [sample]


GOOD = write_tf_message([TfSample("world", "tool", 5, (0.0,) * 6 + (1.0,))])


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (b"", "begins with nothing"),
        (b"\x00\x07" + GOOD[2:], "begins with 0007"),
        (GOOD[:4] + b"\xff\xff\xff\xff" + GOOD[8:], "cannot hold 4294967295"),
        (GOOD[:4], "is invalid"),
        (GOOD[:-9], "is invalid"),
        (GOOD[:16] + b"\x00\x00\x00\x00" + GOOD[20:], "name of 0 bytes"),
        (GOOD[:16] + b"\xff\xff\xff\x7f" + GOOD[20:], "name of 2147483647 bytes"),
        (GOOD[:16] + b"\xff\x03\x00\x00" + GOOD[20:], "ends within a name"),
        (GOOD.replace(b"world", b"wor\xffd"), "is invalid"),
    ],
)
def test_damaged_message_is_refused_with_the_reason(message, reason):
    with pytest.raises(TfInvalidError, match=reason):
        TfMessageReader()(message)


@settings(max_examples=120)
@given(st.binary(max_size=200), st.integers(0, len(GOOD)))
def test_arbitrary_bytes_are_read_or_refused(noise, position):
    try:
        TfMessageReader()(GOOD[:position] + noise)
    except TfInvalidError:
        return
