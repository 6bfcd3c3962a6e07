"""Conversion between ROS images and numpy arrays, without loops over pixels."""

import sys
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from app.bridge.convert.errors import ConversionError
from app.bridge.messages import header_message
from app.geometry import Stamp

ENCODINGS = MappingProxyType(
    {
        "mono8": ("u1", 1),
        "8UC1": ("u1", 1),
        "8SC1": ("i1", 1),
        "rgb8": ("u1", 3),
        "bgr8": ("u1", 3),
        "8UC3": ("u1", 3),
        "rgba8": ("u1", 4),
        "bgra8": ("u1", 4),
        "8UC4": ("u1", 4),
        "mono16": ("u2", 1),
        "16UC1": ("u2", 1),
        "16SC1": ("i2", 1),
        "rgb16": ("u2", 3),
        "32SC1": ("i4", 1),
        "32FC1": ("f4", 1),
        "32FC3": ("f4", 3),
        "64FC1": ("f8", 1),
    }
)
"""Encoding name: numpy type of a sample, samples per pixel."""


def image_array(message: Image) -> NDArray[Any]:
    """Pixels (height, width), or (height, width, samples) for a multi-channel image, top row first.

    The array is read-only, in native byte order, and a view of the message where possible. Raises
    `ConversionError` for an encoding that is not in `ENCODINGS` and for sizes that do not match
    the data.
    """
    sample, samples = _encoding(message.encoding)
    dtype = np.dtype(sample).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = message.width * samples * dtype.itemsize
    data = np.frombuffer(message.data, dtype=np.uint8) if len(message.data) else np.empty(0, "u1")
    if message.step < row_bytes or data.size != message.step * message.height:
        raise ConversionError(
            f"an image of {message.width} x {message.height} {message.encoding} has rows of "
            f"{message.step} and {data.size} bytes: {row_bytes} or more, and height times that"
        )
    rows = data.reshape(message.height, message.step)[:, :row_bytes]
    pixels = rows.view(dtype) if row_bytes else np.empty((message.height, 0), dtype)
    found = pixels.reshape(message.height, message.width, samples)
    found = found[:, :, 0] if samples == 1 else found
    found = found.view() if found.dtype.isnative else found.astype(found.dtype.newbyteorder("="))
    found.flags.writeable = False
    return found


def image_message(pixels: NDArray[Any], encoding: str, frame: str, stamp: Stamp) -> Image:
    """Convert pixels to a message; raises `ConversionError` if they do not fit ``encoding``."""
    sample, samples = _encoding(encoding)
    shape = pixels.shape[:2] if samples == 1 else (*pixels.shape[:2], samples)
    if pixels.ndim < 2 or pixels.shape != shape or pixels.dtype != np.dtype(sample):
        raise ConversionError(
            f"pixels for {encoding} have shape {pixels.shape} and type {pixels.dtype}; expected "
            f"(rows, columns{'' if samples == 1 else f', {samples}'}) and {np.dtype(sample)}"
        )
    message = Image(header=header_message(frame, stamp), encoding=encoding)
    message.height, message.width = (int(size) for size in pixels.shape[:2])
    message.step = message.width * samples * pixels.dtype.itemsize
    message.is_bigendian = int(sys.byteorder == "big")
    message.data.frombytes(np.ascontiguousarray(pixels).tobytes())
    return message


def _encoding(name: str) -> tuple[str, int]:
    if name not in ENCODINGS:
        raise ConversionError(
            f"image encoding is {name!r:.40}; expected one of {', '.join(ENCODINGS)}"
        )
    return ENCODINGS[name]
