"""Conversion of every installed message type, compared with rosbags."""

import math
import random
from importlib import import_module

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore
from rosidl_parser import definition as idl

from app.bridge.convert import ConversionError, from_plain, message_type, to_plain, type_name

pytestmark = pytest.mark.slow

PACKAGES = (
    "diagnostic_msgs",
    "geometry_msgs",
    "marginguard_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "sensor_msgs",
    "shape_msgs",
    "std_msgs",
    "stereo_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "visualization_msgs",
)
KINDS = [
    getattr(module, name)
    for module in (import_module(f"{package}.msg") for package in PACKAGES)
    for name in sorted(dir(module))
    if hasattr(getattr(module, name), "SLOT_TYPES")
]
ROSBAGS = get_typestore(Stores.ROS2_JAZZY)

DTYPES = {
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
}


def random_message(kind, chance):
    """Random message of ``kind``, created without the code under test."""
    message = kind()
    for name, slot in zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True):
        setattr(message, name, random_value(slot, chance))
    return message


def random_value(slot, chance):
    if isinstance(slot, idl.NamespacedType):
        kind = getattr(import_module(".".join(slot.namespaces)), slot.name)
        return random_message(kind, chance)
    if isinstance(slot, idl.AbstractNestedType):
        count = slot.size if isinstance(slot, idl.Array) else chance.randrange(3)
        if isinstance(slot, idl.BoundedSequence):
            count = min(count, slot.maximum_size)
        values = [random_value(slot.value_type, chance) for _ in range(count)]
        kind = getattr(slot.value_type, "typename", "")
        if isinstance(slot, idl.Array) and kind in DTYPES:
            return np.array(values, dtype=DTYPES[kind])
        return values
    if isinstance(slot, idl.BasicType):
        if slot.typename in ("float", "double"):
            value = chance.choice((0.0, -math.inf, chance.gauss(0.0, 1e3), chance.random()))
            return float(np.float32(value)) if slot.typename == "float" else value
        if slot.typename == "boolean":
            return chance.random() < 0.5
        if slot.typename == "octet":
            return bytes([chance.randrange(256)])
        limits = np.iinfo(DTYPES[slot.typename])
        return chance.choice((int(limits.min), int(limits.max), 1))
    return chance.choice(("", "stylus", "Überprüfung 漢字"))


def equal(first, second):
    """True if two messages are equal, with floats up to the rounding of the unit conversion."""
    if hasattr(first, "SLOT_TYPES"):
        return type(first) is type(second) and all(
            equal(getattr(first, name), getattr(second, name))
            for name in first.get_fields_and_field_types()
        )
    if isinstance(first, float | np.floating):
        return math.isclose(first, second, rel_tol=1e-15 if isinstance(first, float) else 1e-6)
    if isinstance(first, str | bytes | int | np.integer):
        return first == second
    return len(first) == len(second) and all(map(equal, first, second))


@pytest.mark.parametrize("kind", KINDS, ids=type_name)
def test_message_converted_there_and_back_is_equal(kind):
    chance = random.Random(type_name(kind))
    for _ in range(5):
        sent = serialize_message(random_message(kind, chance))
        message = deserialize_message(sent, kind)
        assert equal(from_plain(kind, to_plain(message)), message)


VALUES = st.floats(-1e300, 1e300)


@given(VALUES, VALUES, VALUES)
def test_length_keeps_its_precision(x, y, z):
    values = {"x": x, "y": y, "z": z}
    back = to_plain(from_plain("geometry_msgs/Point", values))
    for name, value in values.items():
        assert math.isclose(back[name], value, rel_tol=4e-16, abs_tol=1e-300)


LENGTHS = {
    # type: all fields that are lengths; the others are not scaled
    "geometry_msgs/msg/Pose": {"position.x", "position.y", "position.z"},
    "geometry_msgs/msg/PoseStamped": {"pose.position.x", "pose.position.y", "pose.position.z"},
    "geometry_msgs/msg/TransformStamped": {
        "transform.translation.x",
        "transform.translation.y",
        "transform.translation.z",
    },
    "geometry_msgs/msg/PointStamped": {"point.x", "point.y", "point.z"},
    "geometry_msgs/msg/Vector3": set(),
    "geometry_msgs/msg/Twist": {"linear.x", "linear.y", "linear.z"},
    "geometry_msgs/msg/WrenchStamped": set(),
    "geometry_msgs/msg/Pose2D": {"x", "y"},
    "std_msgs/msg/Float64": set(),
    "std_msgs/msg/ColorRGBA": set(),
    "sensor_msgs/msg/Range": {"min_range", "max_range", "range"},
}


def leaves(values, path=""):
    for name, value in values.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{path}{name}.")
        elif isinstance(value, float):
            yield f"{path}{name}", value


def read_by_rosbags(message, path):
    found = ROSBAGS.deserialize_cdr(bytes(serialize_message(message)), type_name(type(message)))
    for name in path.split("."):
        found = getattr(found, name)
    return found


@pytest.mark.parametrize("name", LENGTHS)
def test_units_of_every_field_agree_with_rosbags(name):
    kind = message_type(name)
    values = to_plain(kind())
    for path, _ in leaves(values):
        *holders, last = path.split(".")
        holder = values
        for each in holders:
            holder = holder[each]
        holder[last] = 250.0
    sent = from_plain(name, values)
    for path, value in leaves(to_plain(sent)):
        if path == "variance":
            continue
        metres = 0.25 if path in LENGTHS[name] else 250.0
        assert read_by_rosbags(sent, path) == metres, path
        assert value == 250.0


def test_nested_points_and_arrays_of_lengths_are_scaled():
    poses = from_plain("PoseArray", {"poses": [{"position": {"z": 5.0}}]})
    assert poses.poses[0].position.z == 0.005
    scan = from_plain("sensor_msgs/LaserScan", {"ranges": [100.0, math.inf], "angle_min": -1.0})
    assert list(scan.ranges) == [pytest.approx(0.1), math.inf]
    assert scan.angle_min == -1.0
    # Covariance of position and angle: mm rad.
    values = to_plain(from_plain("geometry_msgs/PoseWithCovariance", {"covariance": np.ones(36)}))
    assert np.allclose(values["covariance"], 1.0)
    sent = from_plain("geometry_msgs/PoseWithCovariance", {"covariance": np.ones((6, 6))})
    assert sent.covariance.reshape(6, 6)[0, 0] == pytest.approx(1e-6)
    assert sent.covariance.reshape(6, 6)[0, 5] == pytest.approx(1e-3)
    assert sent.covariance.reshape(6, 6)[5, 5] == 1.0
    # Points in pixels are not scaled.
    pixels = from_plain("visualization_msgs/ImageMarker", {"points": [{"x": 3.0}]})
    assert pixels.points[0].x == 3.0
    joints = from_plain("JointState", {"name": ["slide"], "position": [0.1]})
    assert list(joints.position) == [0.1]


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        ("String", {"data": 3}, "String.data is 3; expected a string"),
        ("String", {"data": "\ud800"}, "expected text that utf-8 can encode"),
        ("String", {"text": "x"}, "String has no field 'text'; expected one of data"),
        ("Bool", {"data": 1}, "expected true or false"),
        ("Int", {"data": 1.0}, "expected an integer"),
        ("Int", {"data": True}, "expected an integer"),
        ("Int", {"data": 2**63}, "expected -9223372036854775808 to 9223372036854775807"),
        ("Double", {"data": "1"}, "expected a number"),
        ("Double", {"data": 10**400}, "out of range of the field"),
        ("std_msgs/Float32", {"data": 1e39}, "out of range of a 32-bit float"),
        ("Pose", {"position": [1, 2, 3]}, "Pose.position is .*; expected a mapping"),
        ("PoseArray", {"poses": [{"position": {"x": "a"}}]}, r"PoseArray.poses\[0\].position.x"),
        ("PoseArray", {"poses": {"a": 1}}, "expected a list"),
        ("JointState", {"position": ["a"]}, "expected an array of double"),
        ("JointState", {"name": "waist"}, "expected a list"),
        ("IntArray", {"data": [0.5]}, "expected an array of int64"),
        ("std_msgs/UInt8MultiArray", {"data": [1, 256]}, r"data\[1\] is 256; out of range"),
        ("std_msgs/UInt8MultiArray", {"data": [-1]}, r"data\[0\] is -1"),
        ("sensor_msgs/CameraInfo", {"k": [1.0] * 8}, "8 values; expected 9"),
        ("shape_msgs/SolidPrimitive", {"dimensions": [1.0] * 4}, "4 values; expected at most 3"),
        ("std_msgs/Byte", {"data": 256}, "expected 0 to 255"),
    ],
)
def test_invalid_value_is_refused_with_its_field(kind, values, message):
    with pytest.raises(ConversionError, match=message) as caught:
        from_plain(kind, values)
    assert "\n" not in str(caught.value)


def test_integer_in_a_float_field_keeps_its_value():
    sent = from_plain("Double", {"data": 1})
    assert ROSBAGS.deserialize_cdr(bytes(serialize_message(sent)), "std_msgs/msg/Float64").data == 1


def test_large_arrays_are_views_of_the_message():
    image = from_plain("UInt8Image", {"data": np.zeros(1 << 20, dtype=np.uint8)})
    values = to_plain(image)
    assert np.shares_memory(values["data"], np.frombuffer(image.data, dtype=np.uint8))
    with pytest.raises(ValueError, match="read-only"):
        values["data"][0] = 1


def test_every_length_of_a_constraint_is_in_millimetres():
    fields = FixtureConstraint.get_fields_and_field_types()
    numbers = {name: 1.0 for name, kind in fields.items() if kind == "double"}
    plain = to_plain(FixtureConstraint(**numbers))
    angles = ("free_turn", "max_tool_turn")
    assert {name: plain[name] for name in numbers} == {
        name: 1.0 if name in angles else 1000.0 for name in numbers
    }
