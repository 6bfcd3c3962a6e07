"""Reads ``sensor_msgs/msg/Image`` from its CDR bytes, without ROS or a loop over pixels."""

import struct

import numpy as np

from app.geometry import (
    MAX_IMAGE_SIDE,
    NS_PER_S,
    ImageSample,
    ImageStatus,
    InputError,
    Pixels,
    Stamp,
)

IMAGE = "sensor_msgs/msg/Image"
ENCODINGS = {"mono8": ("u1", 1), "mono16": ("u2", 1), "rgb8": ("u1", 3)}
"""Encoding: type of a value, values of a pixel. Others are not images of an ultrasound device."""

MAX_BYTES = (1 << 25) + 4096
"""32 MiB of pixels and the fields before them."""

_ENCAPSULATION = 4
_BYTE_ORDERS = {b"\0\0": ">", b"\0\1": "<"}
_MAX_TEXT = 256


def read_image_message(data: bytes, number: int) -> ImageSample:
    """Return the image of a message as image ``number``, in the orientation in which it was sent.

    Raises `InputError` for bytes that are not such a message, an encoding that is not one of
    `ENCODINGS`, sizes that do not match the data, and a stamp of 0, which means that none is known.
    """
    if len(data) > MAX_BYTES:
        raise InputError(f"image has {len(data)} bytes; expected {MAX_BYTES} or fewer")
    try:
        return _image(data, number)
    except struct.error as error:
        raise InputError(f"image message of {len(data)} bytes is cut: {error}") from error


def _image(data: bytes, number: int) -> ImageSample:
    order = _BYTE_ORDERS.get(data[:2])
    if order is None:
        raise InputError(f"image message begins with {data[:2].hex()!r}; expected 0000 or 0001")
    body = memoryview(data)[_ENCAPSULATION:]
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", body, 0)
    _, at = _text(body, 8, order)
    at = _aligned(at)
    rows, columns = struct.unpack_from(f"{order}2I", body, at)
    encoding, at = _text(body, at + 8, order)
    big_endian = struct.unpack_from("B", body, at)[0]
    at = _aligned(at + 1)
    row_bytes, size = struct.unpack_from(f"{order}2I", body, at)
    content = body[at + 8 :]
    if seconds < 0 or nanoseconds >= NS_PER_S or not (seconds or nanoseconds):
        raise InputError(f"image has the stamp {seconds} s {nanoseconds} ns; expected a time")
    if encoding not in ENCODINGS:
        raise InputError(
            f"encoding of the image is {encoding[:40]!r}; expected {', '.join(ENCODINGS)}"
        )
    if not (1 <= rows <= MAX_IMAGE_SIDE and 1 <= columns <= MAX_IMAGE_SIDE):
        raise InputError(
            f"image is {columns} x {rows}; expected 1 to {MAX_IMAGE_SIDE} on each side"
        )
    sample, channels = ENCODINGS[encoding]
    needed = columns * channels * np.dtype(sample).itemsize
    if row_bytes < needed or size != rows * row_bytes or not 0 <= len(content) - size <= 3:
        raise InputError(
            f"image of {columns} x {rows} {encoding} has rows of {row_bytes} bytes and "
            f"{len(content)} bytes of pixels; expected {needed} or more, and {rows} times that"
        )
    values = np.frombuffer(content[:size], np.uint8).reshape(rows, row_bytes)[:, :needed]
    dtype = np.dtype(sample).newbyteorder(">" if big_endian else "<")
    pixels: Pixels = np.ascontiguousarray(values).view(dtype).reshape(rows, columns, channels)
    pixels = pixels[:, :, 0] if channels == 1 else pixels
    pixels = pixels.astype(dtype.newbyteorder("="))
    stamp = Stamp(seconds * NS_PER_S + nanoseconds)
    return ImageSample(number, stamp, ImageStatus.OK, pixels)


def _text(body: memoryview, at: int, order: str) -> tuple[str, int]:
    """The string at ``at``, and the place after it."""
    at = _aligned(at)
    (count,) = struct.unpack_from(f"{order}I", body, at)
    end = at + 4 + count
    if not 1 <= count <= _MAX_TEXT or end > len(body) or body[end - 1] != 0:
        raise InputError(
            f"image message has a text of {count} bytes; expected 1 to {_MAX_TEXT} with a "
            "terminating zero"
        )
    return bytes(body[at + 4 : end - 1]).decode("utf-8", "replace"), end


def _aligned(at: int) -> int:
    return -(-at // 4) * 4
