"""Fields and units of messages."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.bridge import messages
from app.bridge.ros_errors import BridgeError
from app.case.frame_streams import JointSample
from app.geometry import Stamp, Transform
from tests.bridge.peers import as_plain

pytestmark = pytest.mark.slow

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


def test_transform_message_has_metres_stamp_and_quaternion():
    transform = Transform("tracker", "cautery", QUARTER_TURN_ABOUT_X, [125.0, -2.5, 1000.0])
    message = as_plain(messages.transform_message(transform, Stamp(1_700_000_000_123_456_789)))
    assert message["header"] == {
        "stamp": {"sec": 1_700_000_000, "nanosec": 123_456_789},
        "frame_id": "tracker",
    }
    assert message["child_frame_id"] == "cautery"
    assert message["transform"]["translation"] == {"x": 0.125, "y": -0.0025, "z": 1.0}
    half = math.sqrt(0.5)
    rotation = {"x": half, "y": 0, "z": 0, "w": half}
    assert message["transform"]["rotation"] == pytest.approx(rotation)


def test_joint_state_message_has_positions_alone():
    sample = JointSample(("slide", "turn"), np.array([0.012, -1.5]), Stamp(3_000_000_007))
    assert as_plain(messages.joint_state_message(sample)) == {
        "header": {"stamp": {"sec": 3, "nanosec": 7}, "frame_id": ""},
        "name": ["slide", "turn"],
        "position": [0.012, -1.5],
        "velocity": [],
        "effort": [],
    }


def test_color_message_has_the_opacity():
    message = as_plain(messages.color_message((1.0, 0.75, 0.0), 0.5))
    assert message == {"r": 1.0, "g": 0.75, "b": 0.0, "a": 0.5}


def test_clock_is_the_players_time():
    clock = messages.clock_message(Stamp(12_000_000_034)).clock
    assert (clock.sec, clock.nanosec) == (12, 34)


def test_point_is_in_metres():
    point = messages.point_message([1.0, 20.0, -300.0])
    assert (point.x, point.y, point.z) == (0.001, 0.02, -0.3)
