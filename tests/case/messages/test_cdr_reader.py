"""Compares the CDR reader with rosbags, which decodes every message by its definition."""

import math
import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import get_types_from_msg

from app.case.messages.decoder import bytes_reader
from app.case.messages.message_values import joint_values, tf_values, tracked_values
from app.case.messages.ros_messages import (
    JOINT_STATE,
    TF_MESSAGE,
    TIME_REFERENCE,
    TRACKED_TRANSFORM,
    TRACKED_TRANSFORM_DEFINITION,
    ros_types,
)

VALUES_OF = {TRACKED_TRANSFORM: tracked_values, TF_MESSAGE: tf_values, JOINT_STATE: joint_values}
TYPES = ros_types().types

names = st.text(max_size=9).filter(lambda text: "\0" not in text)
doubles = st.floats()
stamps = st.builds(
    TYPES["builtin_interfaces/msg/Time"],
    sec=st.integers(-(2**31), 2**31 - 1),
    nanosec=st.integers(0, 2**32 - 1),
)
headers = st.builds(TYPES["std_msgs/msg/Header"], stamp=stamps, frame_id=names)
transforms = st.builds(
    TYPES["geometry_msgs/msg/Transform"],
    translation=st.builds(TYPES["geometry_msgs/msg/Vector3"], x=doubles, y=doubles, z=doubles),
    rotation=st.builds(
        TYPES["geometry_msgs/msg/Quaternion"], x=doubles, y=doubles, z=doubles, w=doubles
    ),
)
stamped = {"header": headers, "child_frame_id": names, "transform": transforms}
arrays = st.lists(doubles, max_size=7).map(np.array)
messages = st.one_of(
    st.builds(TYPES[TRACKED_TRANSFORM], **stamped, status=st.integers(0, 255)),
    st.builds(
        TYPES[TF_MESSAGE],
        transforms=st.lists(
            st.builds(TYPES["geometry_msgs/msg/TransformStamped"], **stamped), max_size=3
        ),
    ),
    st.builds(
        TYPES[JOINT_STATE],
        header=headers,
        name=st.lists(names, max_size=4),
        position=arrays,
        velocity=arrays,
        effort=arrays,
    ),
)


def kind_of(message: Any) -> str:
    return next(kind for kind in VALUES_OF if isinstance(message, TYPES[kind]))


def by_rosbags(data: bytes, kind: str) -> Any:
    return VALUES_OF[kind](ros_types().deserialize_cdr(data, kind))


def cdr(message: Any, **options: Any) -> bytes:
    return bytes(ros_types().serialize_cdr(message, kind_of(message), **options))


def reader_of(message: Any) -> Any:
    return bytes_reader(ros_types().fielddefs, kind_of(message))


def compare_messages(count: int) -> None:
    readers = {kind: bytes_reader(ros_types().fielddefs, kind) for kind in VALUES_OF}
    kinds = set()

    @settings(max_examples=count)
    @given(message=messages)
    def compare(message: Any) -> None:
        kind, data = kind_of(message), cdr(message)
        kinds.add(kind)
        # repr, because NaN is not equal to itself; one reader for all, because it caches names.
        assert repr(readers[kind](data)) == repr(by_rosbags(data, kind))

    compare()
    assert kinds == set(VALUES_OF)


def compare_cut_messages(count):
    @settings(max_examples=count)
    @given(message=messages, cut=st.integers(1, 60))
    def compare(message: Any, cut: int) -> None:
        read, data = reader_of(message), cdr(message)
        for _ in ("before the layout is known", "after"):
            assert read(data[: max(len(data) - cut, 0)]) is None
            assert read(data) is not None

    compare()


def compare_changed_messages(count):
    @settings(max_examples=count)
    @given(message=messages, noise=st.binary(min_size=1, max_size=4), at=st.floats(0.0, 1.0))
    def compare(message: Any, noise: bytes, at: float) -> None:
        kind, data = kind_of(message), bytearray(cdr(message))
        start = round(at * (len(data) - 1))
        data[start : start + len(noise)] = noise[: len(data) - start]
        read = reader_of(message)
        for _ in ("before the layout is known", "after"):
            found = read(bytes(data))
            if found is not None:
                assert repr(found) == repr(by_rosbags(bytes(data), kind))
            assert repr(read(cdr(message))) == repr(by_rosbags(cdr(message), kind))

    compare()


def test_messages_are_decoded_as_by_rosbags():
    compare_messages(80)


def test_a_cut_message_is_left_to_rosbags():
    compare_cut_messages(50)


def test_changed_bytes_are_decoded_as_by_rosbags_or_left_to_it():
    compare_changed_messages(50)


@settings(max_examples=40)
@given(message=messages)
def test_another_byte_order_is_read_and_a_longer_message_left_to_rosbags(message):
    kind, read = kind_of(message), reader_of(message)
    for _ in ("before the layout is known", "after"):
        for is_little in (False, True):
            data = cdr(message, little_endian=is_little)
            assert repr(read(data)) == repr(by_rosbags(data, kind))
            assert read(data + b"\0" * 4) is None


def defined(definition: str) -> Typesdict:
    return {**ros_types().fielddefs, **get_types_from_msg(definition, TRACKED_TRANSFORM)}


@pytest.mark.parametrize(
    "definition",
    [
        TRACKED_TRANSFORM_DEFINITION.replace("uint8 status", "uint16 status"),
        TRACKED_TRANSFORM_DEFINITION.replace("uint8 status", "uint8 quality"),
        TRACKED_TRANSFORM_DEFINITION.replace("child_frame_id", "other_id"),
        TRACKED_TRANSFORM_DEFINITION + "float64 extra\n",
    ],
)
def test_another_definition_is_left_to_rosbags(definition):
    assert bytes_reader(defined(definition), TRACKED_TRANSFORM) is None


def test_comments_and_constants_of_a_definition_do_not_matter():
    definitions = defined("# ours\nuint8 NEW=9\n" + TRACKED_TRANSFORM_DEFINITION)
    assert bytes_reader(definitions, TRACKED_TRANSFORM) is not None
    assert bytes_reader(definitions, TIME_REFERENCE) is None


@pytest.mark.parametrize("field", ["a/msg/Unknown x", f"{TRACKED_TRANSFORM} itself"])
def test_recursive_or_unknown_definition_is_left_to_rosbags(field):
    definitions = get_types_from_msg(f"{field}\n", TRACKED_TRANSFORM)
    assert bytes_reader(definitions, TRACKED_TRANSFORM) is None


@pytest.mark.parametrize("innermost", ["int32 x", ""])
def test_exponential_definition_is_not_expanded(innermost):
    looked_up = []

    class Counted(dict[str, Any]):
        def __getitem__(self, name: str) -> Any:
            looked_up.append(name)
            return super().__getitem__(name)

    separator = "\n" + 80 * "=" + "\n"
    parts = ["a/T0 x\n"]
    parts += [f"MSG: a/T{k}\na/T{k + 1} x\na/T{k + 1} y\n" for k in range(10)]
    parts.append(f"MSG: a/T10\n{innermost}\n")
    definitions = Counted(get_types_from_msg(separator.join(parts), TRACKED_TRANSFORM))
    assert bytes_reader(definitions, TRACKED_TRANSFORM) is None
    assert len(looked_up) < 20  # of 2048


def test_alternating_robots_keep_their_joint_names():
    def joints(*of: str) -> bytes:
        header = TYPES["std_msgs/msg/Header"](
            stamp=TYPES["builtin_interfaces/msg/Time"](sec=1, nanosec=2), frame_id=""
        )
        none = np.empty(0)
        message = TYPES[JOINT_STATE](
            header=header, name=list(of), position=np.arange(2.0), velocity=none, effort=none
        )
        return cdr(message)

    read = bytes_reader(ros_types().fielddefs, JOINT_STATE)
    for names in (("a", "b"), ("a", "b"), ("c", "d"), ("a", "bc")):
        assert read(joints(*names)).names == names


def test_a_name_without_its_closing_zero_is_left_to_rosbags():
    header = struct.pack("<iI", 1, 2) + struct.pack("<I", 4) + b"worl"
    child = struct.pack("<I", 4) + b"arm\0"
    body = header + child + struct.pack("<7dB", *(math.nan,) * 7, 0)
    assert bytes_reader(ros_types().fielddefs, TRACKED_TRANSFORM)(b"\0\1\0\0" + body) is None
