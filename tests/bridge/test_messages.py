"""Fields and units of messages, checked in another process."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA

from app.bridge import messages
from app.bridge.errors import BridgeError
from app.bridge.node import RosNode
from app.bridge.qos import LATCHED, Topic
from app.case.frames.samples import JointSample
from app.geometry import Stamp, Transform

LAST_NS = (2**31 - 1) * 10**9
QUARTER_TURN_ABOUT_X = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]


@given(st.integers(-LAST_NS, LAST_NS))
def test_time_is_exact_to_the_nanosecond_in_messages(ns):
    message = messages.time_message(Stamp(ns))
    assert 0 <= message.nanosec < 10**9
    assert message.sec * 10**9 + message.nanosec == ns


@pytest.mark.parametrize("ns", [2**31 * 10**9, -(2**31) * 10**9])
def test_time_out_of_range_is_refused(ns):
    with pytest.raises(BridgeError, match=str(ns)):
        messages.time_message(Stamp(ns))


finite = st.floats(-1e4, 1e4)


@given(st.tuples(finite, finite, finite), st.tuples(*[st.floats(-3.1, 3.1)] * 3))
def test_transform_message_agrees_with_the_transform(translation, turn):
    transform = Transform.from_rotation_vector(turn, translation, target="parent", source="child")
    message = messages.transform_message(transform, Stamp(5))
    q, t = message.transform.rotation, message.transform.translation
    # Rotation by quaternion products, independent of scipy and of the rotation matrix.
    point_m = np.array([0.1, -0.2, 0.3])
    vector = np.array([q.x, q.y, q.z])
    rotated_m = point_m + 2 * np.cross(vector, np.cross(vector, point_m) + q.w * point_m)
    moved_m = rotated_m + np.array([t.x, t.y, t.z])
    assert moved_m * 1000 == pytest.approx(transform.apply(point_m * 1000), abs=1e-8)
    assert q.w >= 0


def received_elsewhere(domain_id, start_receiver, message, kind):
    """The message as received by another process."""
    topic = Topic("/sent", type(message), LATCHED)
    with RosNode("sender", domain_id=domain_id) as ros:
        ros.publisher(topic).publish(message)
        return start_receiver(f"/sent:{kind}:1:latched").messages()[0]["message"]


def test_transform_is_received_by_another_process(domain_id, start_receiver):
    transform = Transform("tracker", "cautery", QUARTER_TURN_ABOUT_X, [125.0, -2.5, 1000.0])
    message = messages.transform_message(transform, Stamp(1_700_000_000_123_456_789))
    received = received_elsewhere(
        domain_id, start_receiver, message, "geometry_msgs/msg/TransformStamped"
    )
    assert isinstance(message, TransformStamped)
    assert received["header"] == {
        "stamp": {"sec": 1_700_000_000, "nanosec": 123_456_789},
        "frame_id": "tracker",
    }
    assert received["child_frame_id"] == "cautery"
    assert received["transform"]["translation"] == {"x": 0.125, "y": -0.0025, "z": 1.0}
    half = math.sqrt(0.5)
    assert received["transform"]["rotation"] == pytest.approx(
        {"x": half, "y": 0, "z": 0, "w": half}
    )


def test_joint_state_is_received_by_another_process(domain_id, start_receiver):
    sample = JointSample(("slide", "turn"), np.array([0.012, -1.5]), Stamp(3_000_000_007))
    message = messages.joint_state_message(sample)
    received = received_elsewhere(domain_id, start_receiver, message, "sensor_msgs/msg/JointState")
    assert isinstance(message, JointState)
    assert received == {
        "header": {"stamp": {"sec": 3, "nanosec": 7}, "frame_id": ""},
        "name": ["slide", "turn"],
        "position": [0.012, -1.5],
        "velocity": [],
        "effort": [],
    }


def test_color_is_received_by_another_process(domain_id, start_receiver):
    message = messages.color_message((1.0, 0.75, 0.0), 0.5)
    received = received_elsewhere(domain_id, start_receiver, message, "std_msgs/msg/ColorRGBA")
    assert isinstance(message, ColorRGBA)
    assert received == {"r": 1.0, "g": 0.75, "b": 0.0, "a": 0.5}


def test_clock_is_the_players_time():
    clock = messages.clock_message(Stamp(12_000_000_034)).clock
    assert (clock.sec, clock.nanosec) == (12, 34)


def test_point_is_in_metres():
    point = messages.point_message([1.0, 20.0, -300.0])
    assert (point.x, point.y, point.z) == (0.001, 0.02, -0.3)
