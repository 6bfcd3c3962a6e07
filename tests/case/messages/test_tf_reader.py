"""The reader of tf messages and its cache of layouts, compared with a parser without a cache."""

import struct
import tracemalloc
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.case.messages.cdr_layout import Known, LayoutReader, Walk
from app.case.messages.decoder import tf_reader
from app.case.messages.ros_messages import TF_MESSAGE, ros_types
from tests.oracles.tf_cdr import TfFields, tf_fields

TYPES = ros_types().types
names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9)
numbers = st.floats(allow_nan=False)


def transform(parent: str, child: str, sec: int, nanosec: int, pose: tuple[float, ...]) -> Any:
    x, y, z, qx, qy, qz, qw = pose
    return TYPES["geometry_msgs/msg/TransformStamped"](
        header=TYPES["std_msgs/msg/Header"](
            stamp=TYPES["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=parent
        ),
        child_frame_id=child,
        transform=TYPES["geometry_msgs/msg/Transform"](
            translation=TYPES["geometry_msgs/msg/Vector3"](x=x, y=y, z=z),
            rotation=TYPES["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
        ),
    )


transforms = st.builds(
    transform,
    names,
    names,
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**32 - 1),
    st.tuples(*[numbers] * 7),
)


def cdr(samples: list[Any], *, little_endian: bool = True) -> bytes:
    message = TYPES[TF_MESSAGE](transforms=samples)
    return bytes(ros_types().serialize_cdr(message, TF_MESSAGE, little_endian=little_endian))


def read(reader: Any, data: bytes) -> list[TfFields]:
    return [TfFields(*values[:5]) for values in reader(data)]


def compare_messages(count: int) -> None:
    reader = tf_reader()

    @settings(max_examples=count)
    @given(samples=st.lists(transforms, max_size=4), little_endian=st.booleans())
    def compare(samples: list[Any], little_endian: bool) -> None:
        data = cdr(samples, little_endian=little_endian)
        assert read(reader, data) == tf_fields(data)

    compare()


def compare_changed_messages(count):
    @settings(max_examples=count)
    @given(
        samples=st.lists(transforms, min_size=1, max_size=3),
        noise=st.binary(min_size=1, max_size=4),
        at=st.floats(0.0, 1.0),
    )
    def compare(samples: list[Any], noise: bytes, at: float) -> None:
        data = bytearray(cdr(samples))
        start = round(at * (len(data) - 1))
        data[start : start + len(noise)] = noise[: len(data) - start]
        reader = tf_reader()
        for _ in ("before the layout is known", "after"):
            try:
                found = read(reader, bytes(data))
            except ValueError:
                with pytest.raises((ValueError, KeyError, struct.error)):
                    tf_fields(bytes(data))
            else:
                assert repr(found) == repr(tf_fields(bytes(data)))
            assert read(reader, cdr(samples)) == tf_fields(cdr(samples))

    compare()


def test_messages_of_both_byte_orders_are_read_with_one_reader():
    compare_messages(50)


def test_changed_bytes_are_read_as_by_the_oracle_or_refused():
    compare_changed_messages(50)


GOOD = cdr([transform("world", "tool", 1, 2, (0.0,) * 6 + (1.0,))])


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "begins with nothing; expected 0000 or 0001"),
        (b"\x00\x07" + GOOD[2:], "begins with 0007"),
        (GOOD[:4], "unpack_from requires a buffer"),
        (GOOD[:4] + b"\xff\xff\xff\xff" + GOOD[8:], "cannot hold 4294967295 items"),
        (GOOD[:-9], "its last 9 bytes are missing"),
        (GOOD + bytes(4), "4 bytes after the last value; expected 0 to 3"),
        (GOOD[:16] + b"\0\0\0\0" + GOOD[20:], "a name of 0 bytes; expected 1 to 1024"),
        (GOOD[:16] + b"\x01\x04\0\0" + GOOD[20:], "a name of 1025 bytes; expected 1 to 1024"),
        (GOOD[:16] + b"\xff\x03\0\0" + GOOD[20:], "ends within a name"),
        (GOOD.replace(b"world\0", b"worlds"), "a name without its terminating zero"),
        (GOOD.replace(b"world", b"wor\xffd"), "can't decode"),
    ],
)
def test_other_bytes_are_refused_with_the_reason(data, reason):
    reader = tf_reader()
    for _ in ("before the layout is known", "after"):
        with pytest.raises(ValueError, match=reason):
            reader(data)
        assert len(reader(GOOD)) == 1


def test_frame_names_are_kept_as_sent():
    data = cdr([transform("/world", "tool", 1, 2, (0.0,) * 6 + (1.0,))])
    assert [(values.target, values.source) for values in tf_reader()(data)] == [("/world", "tool")]


HEAD = b"\0\1\0\0"


def walk_named(walk: Walk) -> Known:
    walk.numbers("I", 4)
    name = walk.text()
    return {walk.fixed(): name}


def named(numbers: tuple[int, bytes], known: Known) -> tuple[str, int]:
    number, stretch = numbers
    return known[stretch], number


def message(number: int, name: str) -> bytes:
    text = name.encode() + b"\0"
    return HEAD + struct.pack("<II", number, len(text)) + text


def test_names_are_decoded_in_any_order_and_repeatedly():
    read = LayoutReader(walk_named, named)
    # Of one length, of others, with padding to the same length, and each more than once.
    for number, name in enumerate(["arm", "leg", "arm", "needle", "", "leg", "arm"] * 2):
        assert read(message(number, name)) == (name, number)
    assert read(message(1, "ar") + b"\0") == ("ar", 1)
    assert read(message(2, "arm")) == ("arm", 2)


def test_invalid_bytes_give_none_and_leave_the_cache_unchanged():
    read = LayoutReader(walk_named, named)
    assert read(message(1, "arm")) == ("arm", 1)
    assert read(message(1, "arm")[:-1] + b"m") is None  # no terminating zero
    assert read(HEAD) is None
    assert read(message(1, "arm") + bytes(4)) is None
    assert read(message(3, "arm")) == ("arm", 3)


def test_many_distinct_names_do_not_fill_the_memory():
    read = LayoutReader(walk_named, named)
    tracemalloc.start()
    try:
        for number in range(3000):
            name = f"{number:05d}" + "x" * (4000 + number % 2)
            assert read(message(number, name)) == (name, number)
        for number in range(100):
            name = "y" * (100_000 + number)
            assert read(message(number, name)) == (name, number)
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 12_000_000  # all of them would be 34 million bytes
