"""Bytes of transforms and joints, against the messages that rclpy serialises."""

from collections.abc import Sequence

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Float64, Header
from tf2_msgs.msg import TFMessage

from app.bridge.messages import color_message, joint_state_message
from app.bridge.publishing.serialized import (
    Block,
    NumberTemplate,
    SerializedJoints,
    SerializedMargin,
    SerializedTransforms,
)
from app.bridge.ros_errors import BridgeError
from app.bridge.tf_topics import tf_message
from app.case.frame_streams import JointSample
from app.fixture import MarginState
from app.geometry import Stamp, Transform

pytestmark = pytest.mark.slow

EDGES = (("reference", "needle"), ("reference", "cautery_of_the_robot"), ("base", "link/1"))


def samples(
    edges: Sequence[tuple[str, str]], generator: np.random.Generator
) -> list[tuple[Transform, Stamp]]:
    return [
        (
            Transform.from_rotation_vector(
                generator.normal(size=3), generator.normal(size=3), target=target, source=source
            ),
            Stamp(int(generator.integers(-(10**18), 10**18))),
        )
        for target, source in edges
    ]


def test_transforms_are_those_of_the_message():
    generator = np.random.default_rng(3)
    serialized = SerializedTransforms()
    for edges in (EDGES, EDGES[:1], EDGES, EDGES[1:], EDGES[::-1], EDGES):
        given = samples(edges, generator)
        assert deserialize_message(serialized.message(given), TFMessage) == tf_message(given)


def test_more_sets_of_edges_than_are_kept():
    generator = np.random.default_rng(4)
    serialized = SerializedTransforms()
    for number in range(70):
        given = samples((("map", f"frame_{number}"),), generator)
        assert deserialize_message(serialized.message(given), TFMessage) == tf_message(given)


@pytest.mark.parametrize("names", [(), ("turn",), ("first", "second joint", "third")])
def test_joints_are_those_of_the_message(names):
    serialized = SerializedJoints()
    for step in range(3):
        positions = tuple(-0.5 * step + 0.1 * index for index in range(len(names)))
        sample = JointSample(names, positions, Stamp(7 + 10**9 * step))
        found = deserialize_message(serialized.message(sample), JointState)
        assert found == joint_state_message(sample)


@pytest.mark.parametrize("names", [(), ("turn",), ("first", "second joint", "third")])
def test_bytes_of_joints_end_with_the_message(names):
    raw = SerializedJoints().message(JointSample(names, (0.5,) * len(names), Stamp(7)))
    store = get_typestore(Stores.ROS2_JAZZY)
    found = store.deserialize_cdr(raw, "sensor_msgs/msg/JointState")  # rejects what is left over
    assert found.position.tolist() == [0.5] * len(names)
    assert len(raw) == len(store.serialize_cdr(found, "sensor_msgs/msg/JointState"))


def test_bytes_of_transforms_end_with_the_message():
    raw = SerializedTransforms().message(samples(EDGES, np.random.default_rng(5)))
    store = get_typestore(Stores.ROS2_JAZZY)
    found = store.deserialize_cdr(raw, "tf2_msgs/msg/TFMessage")
    assert len(raw) == len(store.serialize_cdr(found, "tf2_msgs/msg/TFMessage"))


def test_stamp_beyond_a_ros_time_raises():
    with pytest.raises(BridgeError, match="does not fit a ROS time"):
        SerializedJoints().message(JointSample(("turn",), (0.0,), Stamp(2**61)))


def point_of(numbers: Sequence[float], block: Block, frame: str = "") -> PointStamped:
    message = PointStamped(header=Header(frame_id=frame))
    message.header.stamp.sec, message.header.stamp.nanosec = block[0]
    message.point.x, message.point.y, message.point.z = numbers
    return message


def test_text_that_depends_on_the_numbers_raises():
    with pytest.raises(BridgeError, match="other fields depend"):
        NumberTemplate(lambda b: point_of(b[0][1], b[0], f"{b[0][1][0] < 1.5e100:d}"), [3])


@pytest.mark.parametrize("order", [(2, 1, 0), (0, 0, 1)])
def test_numbers_that_are_not_adjacent_raise(order):
    with pytest.raises(BridgeError, match="a mark occurs 0 times"):
        NumberTemplate(lambda b: point_of([b[0][1][k] for k in order], b[0]), [3])


def test_numbers_that_occur_twice_raise():
    with pytest.raises(BridgeError, match="a mark occurs 3 times"):
        NumberTemplate(lambda b: point_of([b[0][1][0]] * 3, b[0]), [1])


def test_margin_is_that_of_the_messages():
    serialized = SerializedMargin()
    for distance in (0.0, -1.25, 1e300, float("inf"), float("nan")):
        found = deserialize_message(serialized.distance(distance), Float64).data
        np.testing.assert_equal(found, distance)
    for state in MarginState:
        found = deserialize_message(serialized.color(state), ColorRGBA)
        expected = serialize_message(color_message(state.color))
        assert found == deserialize_message(expected, ColorRGBA)  # float32
