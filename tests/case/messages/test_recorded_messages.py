"""Messages that are recorded equal those of rosbags, in bytes and in definition."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

from app.case import message_definition
from app.case.frame_streams import JointSample
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TRACKED_TRANSFORM,
    joint_state_bytes,
    ros_types,
    tf_bytes,
    tracked_transform_bytes,
)
from app.geometry import InputError, Stamp, TrackedTransform, TrackingStatus, Transform
from tests.oracles.ros_objects import joint_state_message, tf_message, tracked_transform_message

NAMES = ("a", "needle", "reference", "tracker_of_the_room", "a.b-c/d")


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def pose(rng: np.random.Generator, ns: int, names: tuple[str, str]) -> TrackedTransform:
    transform = Transform(
        *names, Rotation.random(rng=rng).as_matrix(), rng.uniform(-500.0, 500.0, 3)
    )
    return TrackedTransform(transform, Stamp(ns), TrackingStatus.OK)


def rosbags(message: object, kind: str) -> bytes:
    return bytes(ros_types().serialize_cdr(message, kind))


def pairs(rng: np.random.Generator) -> list[tuple[str, str]]:
    return [tuple(map(str, rng.choice(NAMES, 2, replace=False))) for _ in range(12)]


def test_tracked_transforms_of_any_names_and_status(rng):
    for k, names in enumerate(pairs(rng)):
        for sample in (
            pose(rng, 10**9 * k + 7, names),
            TrackedTransform.lost(*names, Stamp(k), TrackingStatus.OUT_OF_VIEW),
        ):
            expected = rosbags(tracked_transform_message(sample), TRACKED_TRANSFORM)
            assert tracked_transform_bytes(sample) == expected


def test_tf_messages_of_several_transforms(rng):
    for count in (1, 2, 3, 5):
        samples = [pose(rng, 5 * k, names) for k, names in enumerate(pairs(rng)[:count])]
        assert tf_bytes(samples) == rosbags(tf_message(samples), TF_MESSAGE)


def test_joint_states_of_any_number_of_joints(rng):
    for count in (0, 1, 2, 3, 6, 7):
        names = tuple(f"joint{'_' * k}{k}" for k in range(count))
        sample = JointSample(names, tuple(rng.normal(size=count)), Stamp(3, "robot"))
        expected = rosbags(joint_state_message(sample, 1_700_000_000_123_456_789), JOINT_STATE)
        assert joint_state_bytes(sample, 1_700_000_000_123_456_789) == expected


def test_a_message_does_not_keep_numbers_of_the_one_before(rng):
    first, lost = (
        pose(rng, 1, ("a", "b")),
        TrackedTransform.lost("a", "b", Stamp(2), TrackingStatus.INVALID),
    )
    before = tracked_transform_bytes(first)
    tracked_transform_bytes(lost)
    assert tracked_transform_bytes(first) == before


def test_times_before_1970_and_beyond_ros_time():
    sample = JointSample(("a",), (math.pi,), Stamp(0))
    expected = rosbags(joint_state_message(sample, -1), JOINT_STATE)
    assert joint_state_bytes(sample, -1) == expected
    with pytest.raises(InputError, match="expected a ROS time"):
        joint_state_bytes(sample, 2**31 * 10**9)


PREFIXES = [Path(sys.prefix)]


@pytest.mark.parametrize(
    "name",
    ["tf2_msgs/msg/TFMessage", "sensor_msgs/msg/JointState", "visualization_msgs/msg/MarkerArray"],
)
def test_definitions_are_those_that_rosbags_knows(name):
    types = get_types_from_msg(message_definition(name, PREFIXES), name)
    known = get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    # The hash of a type covers its fields and all of their types.
    assert store.hash_rihs01(name) == known.hash_rihs01(name)


def test_definitions_of_this_project_include_nested_types():
    name = "marginguard_msgs/msg/FixtureConstraint"
    types = get_types_from_msg(message_definition(name, PREFIXES), name)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    assert store.generate_msgdef(name, ros_version=2)
    assert "marginguard_msgs/msg/HalfSpace" in types


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Nothing", "std_msgs/String", "../msg/Secret"])
def test_unknown_types_are_refused(name):
    with pytest.raises(InputError):
        message_definition(name, PREFIXES)
