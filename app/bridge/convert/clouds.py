"""Conversion between ROS point clouds and numpy arrays, with points in mm."""

import sys
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from app.bridge.convert.errors import ConversionError
from app.bridge.messages import MM_PER_M, header_message
from app.geometry import FloatArray, Stamp

_TYPES = MappingProxyType(
    {
        PointField.INT8: "i1",
        PointField.UINT8: "u1",
        PointField.INT16: "i2",
        PointField.UINT16: "u2",
        PointField.INT32: "i4",
        PointField.UINT32: "u4",
        PointField.FLOAT32: "f4",
        PointField.FLOAT64: "f8",
    }
)
_MAX_FIELDS = 256
_MAX_POINT_BYTES = 1 << 16


def cloud_array(message: PointCloud2) -> NDArray[Any]:
    """Structured array (n,) with the fields and units of the cloud.

    The array is a read-only view of the message. Raises `ConversionError` if fields or sizes do
    not match the data.
    """
    data = np.frombuffer(message.data, dtype=np.uint8) if len(message.data) else np.empty(0, "u1")
    row_bytes = message.width * message.point_step
    if message.row_step < row_bytes or data.size != message.row_step * message.height:
        raise ConversionError(
            f"a cloud of {message.width} x {message.height} points of {message.point_step} bytes "
            f"has rows of {message.row_step} bytes and {data.size} bytes in total; "
            f"expected rows of at least {row_bytes} bytes and a matching total"
        )
    if message.point_step > _MAX_POINT_BYTES:
        raise ConversionError(
            f"a point of a cloud has {message.point_step} bytes; "
            f"expected at most {_MAX_POINT_BYTES}"
        )
    point = _point(message)
    if row_bytes * message.height == 0:
        return np.empty(0, dtype=point)
    rows = data.reshape(message.height, message.row_step)[:, :row_bytes]
    found = np.ascontiguousarray(rows).view(point).reshape(-1)
    found.flags.writeable = False
    return found


def cloud_points_mm(message: PointCloud2) -> FloatArray:
    """Points (n, 3) in mm; NaN where the sensor has no measurement. Raises `ConversionError`."""
    cloud = cloud_array(message)
    names = cloud.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise ConversionError(f"a cloud has the fields {', '.join(names)}; expected x, y and z")
    for name in "xyz":
        if cloud.dtype[name].shape or cloud.dtype[name].kind not in "fiu":
            raise ConversionError(
                f"field {name} of a cloud is {cloud.dtype[name]}; expected a number"
            )
    return np.stack([cloud[name].astype(np.float64) for name in "xyz"], axis=1) * MM_PER_M


def cloud_message(points_mm: FloatArray, frame: str, stamp: Stamp) -> PointCloud2:
    """Convert points (n, 3) in mm to a cloud of 32-bit floats in m, the common layout in ROS."""
    points = np.asarray(points_mm, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ConversionError(f"points have shape {points.shape}; expected (n, 3)")
    message = PointCloud2(header=header_message(frame, stamp), height=1, width=len(points))
    message.fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate("xyz")
    ]
    message.point_step = 12
    message.row_step = 12 * len(points)
    message.is_bigendian = sys.byteorder == "big"
    message.is_dense = bool(np.isfinite(points).all())
    message.data.frombytes((points / MM_PER_M).astype(np.float32).tobytes())
    return message


def _point(message: PointCloud2) -> np.dtype[Any]:
    order = ">" if message.is_bigendian else "<"
    names = [field.name for field in message.fields]
    if len(names) > _MAX_FIELDS or len(set(names)) != len(names) or "" in names:
        raise ConversionError(
            f"a cloud has {len(names)} fields; expected at most {_MAX_FIELDS} with unique names"
        )
    formats: list[Any] = []
    for field in message.fields:
        kind = _TYPES.get(field.datatype)
        if kind is None or field.count < 1:
            raise ConversionError(
                f"field {field.name!r:.40} of a cloud has type {field.datatype} and "
                f"count {field.count}; expected a type from 1 to {max(_TYPES)} and a count of at "
                "least 1"
            )
        size = np.dtype(kind).itemsize * field.count
        if field.offset + size > message.point_step:
            raise ConversionError(
                f"field {field.name!r:.40} of a cloud ends at byte {field.offset + size}; "
                f"expected at most {message.point_step}, the size of a point"
            )
        formats.append(order + kind if field.count == 1 else (order + kind, (field.count,)))
    return np.dtype(
        {
            "names": names,
            "formats": formats,
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
