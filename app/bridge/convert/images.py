"""Images of ROS as numpy arrays, without touching a pixel one by one."""

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
"""Name of an encoding: type of a sample, samples of a pixel."""


def image_array(message: Image) -> NDArray[Any]:
    """Rows from the top: (height, width), or (height, width, samples) of a coloured image.

    Looks into the message, read-only; values as they are (the bytes in this machine's order).
    Raises `ConversionError` for an encoding that is not in the table, and for sizes that do not
    fit the data.
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
    """An image in ``encoding``; raises `ConversionError` when the array is not one of that kind."""
    sample, samples = _encoding(encoding)
    wanted = pixels.shape[:2] if samples == 1 else (*pixels.shape[:2], samples)
    if pixels.ndim < 2 or pixels.shape != wanted or pixels.dtype != np.dtype(sample):
        raise ConversionError(
            f"{encoding} from an array {pixels.shape} of {pixels.dtype}: (rows, columns"
            f"{'' if samples == 1 else f', {samples}'}) of {np.dtype(sample)} wanted"
        )
    message = Image(header=header_message(frame, stamp), encoding=encoding)
    message.height, message.width = (int(size) for size in pixels.shape[:2])
    message.step = message.width * samples * pixels.dtype.itemsize
    message.is_bigendian = int(sys.byteorder == "big")
    message.data.frombytes(np.ascontiguousarray(pixels).tobytes())
    return message


def _encoding(name: str) -> tuple[str, int]:
    if name not in ENCODINGS:
        raise ConversionError(f"encoding {name!r:.40} of an image: {', '.join(ENCODINGS)} wanted")
    return ENCODINGS[name]
