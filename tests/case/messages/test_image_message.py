"""``sensor_msgs/Image`` from bytes that rosbags has encoded, and messages that are refused."""

import struct
from typing import Any

import numpy as np
import pytest

from app.case import read_image_message
from app.case.messages.message_values import IMAGE
from app.case.messages.ros_messages import ros_types
from app.geometry import InputError, Stamp
from tests.case.images.sequences import some_pixels
from tests.refusals import refused

STAMP = (1_700_000_000, 123_456_789)


def message(pixels: np.ndarray, encoding: str, **changes: Any) -> Any:
    """The message of ``pixels``, with little-endian values and two bytes of padding in a row."""
    types = ros_types().types
    rows = pixels.astype(pixels.dtype.newbyteorder("<")).reshape(len(pixels), -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, 2)), constant_values=99)
    values = {
        "header": types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](*STAMP), "image"
        ),
        "height": pixels.shape[0],
        "width": pixels.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": padded.shape[1],
        "data": padded.ravel(),
    }
    return types[IMAGE](**{**values, **changes})


def encoded(content: Any, *, little_endian: bool = True) -> bytes:
    return bytes(ros_types().serialize_cdr(content, IMAGE, little_endian=little_endian))


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize(
    ("encoding", "kind", "channels"),
    [("mono8", "uint8", 1), ("mono16", "uint16", 1), ("rgb8", "uint8", 3)],
)
def test_image_of_rosbags_is_read(encoding, kind, channels, little_endian):
    pixels = some_pixels(1, 5, 7, kind, channels)[0]
    data = encoded(message(pixels, encoding), little_endian=little_endian)
    found = read_image_message(data, 3)
    assert (found.number, found.stamp) == (3, Stamp(STAMP[0] * 10**9 + STAMP[1]))
    assert found.pixels is not None and found.pixels.dtype == np.dtype(kind)
    np.testing.assert_array_equal(found.pixels, pixels)


def test_big_endian_values_are_read():
    pixels = some_pixels(1, 4, 6, "uint16")[0]
    rows = pixels.astype(">u2").view(np.uint8)
    content = message(pixels, "mono16", is_bigendian=1, step=12, data=rows.ravel())
    np.testing.assert_array_equal(read_image_message(encoded(content), 0).pixels, pixels)


GREY = some_pixels(1, 5, 7)[0]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"encoding": "bgr8"}, "encoding of the image is 'bgr8'; expected mono8, mono16, rgb8"),
        ({"encoding": "x" * 300}, "has a text of 301 bytes; expected 1 to 256"),
        ({"height": 4}, "image of 7 x 4 mono8 has rows of 9 bytes and 45 bytes of pixels"),
        ({"step": 6}, "has rows of 6 bytes and 45 bytes of pixels; expected 7 or more"),
        ({"width": 0}, "image is 0 x 5; expected 1 to 8192 on each side"),
        ({"height": 9000}, "image is 7 x 9000; expected 1 to 8192 on each side"),
        ({"data": np.zeros(0, np.uint8)}, "0 bytes of pixels"),
    ],
)
def test_message_that_is_no_image_is_refused_by_one_line(changes, expected):
    encoding = changes.pop("encoding", "mono8")
    with refused(text=expected):
        read_image_message(encoded(message(GREY, encoding, **changes)), 0)


def test_stamp_of_zero_is_refused():
    data = bytearray(encoded(message(GREY, "mono8")))
    data[4:12] = struct.pack("<iI", 0, 0)
    with pytest.raises(InputError, match="stamp 0 s 0 ns; expected a time"):
        read_image_message(bytes(data), 0)


def test_each_cut_of_a_message_is_refused():
    data = encoded(message(GREY, "mono8"))
    for size in range(len(data)):
        with pytest.raises(InputError):
            read_image_message(data[:size], 0)
    with pytest.raises(InputError, match="expected 33558528 or fewer"):
        read_image_message(bytes((1 << 25) + 5000), 0)
