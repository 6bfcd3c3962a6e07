"""Conversion between numpy arrays in mm and ROS point clouds, images and collision objects."""

import sys
from types import MappingProxyType
from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField
from shape_msgs.msg import Mesh, MeshTriangle

from app.bridge.convert.plain import message_type
from app.bridge.messages import MM_PER_M, header_message, point_message, quaternion_message
from app.bridge.ros_errors import ConversionError
from app.geometry import FloatArray, Stamp, Transform

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

_TYPE = "moveit_msgs/msg/CollisionObject"


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


def mesh_message(vertices_mm: ArrayLike, triangles: ArrayLike) -> Mesh:
    """Mesh in m of vertices (n, 3) in mm and triangles (m, 3) of their indices.

    Raises `ConversionError` without a triangle, for a vertex that is not finite, and for an index
    that is out of range.
    """
    vertices, corners = np.asarray(vertices_mm, dtype=np.float64), np.asarray(triangles)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or corners.ndim != 2 or corners.shape[1] != 3:
        raise ConversionError(
            f"a mesh has vertices {vertices.shape} and triangles {corners.shape}; "
            "expected (n, 3) and (m, 3)"
        )
    if not len(corners):
        raise ConversionError("a mesh has no triangles; expected at least one")
    if not np.isfinite(vertices).all():
        row = int((~np.isfinite(vertices)).any(axis=1).argmax())
        raise ConversionError(
            f"vertex {row} of a mesh is {vertices[row].tolist()}; expected finite coordinates"
        )
    low, high = int(corners.min()), int(corners.max())
    if low < 0 or high >= len(vertices):
        raise ConversionError(
            f"triangles of a mesh use vertices {low} to {high}; expected 0 to {len(vertices) - 1}"
        )
    message = Mesh()
    message.vertices = [point_message(vertex) for vertex in vertices]
    message.triangles = [MeshTriangle(vertex_indices=row) for row in corners.astype(np.uint32)]
    return message


def collision_object(
    identifier: str, vertices_mm: ArrayLike, triangles: ArrayLike, pose: Transform
) -> Any:
    """`CollisionObject` with operation ADD: one mesh, in the object's frame, at ``pose``.

    ``pose`` is the object's pose in the frame that the caller sets in the header. Raises
    `ConversionError` as `mesh_message`, and `UnknownTypeError` if moveit_msgs is not installed.
    """
    message = _named(identifier)
    message.operation = message.ADD
    message.pose.position = point_message(pose.translation_mm)
    message.pose.orientation = quaternion_message(pose)
    message.meshes = [mesh_message(vertices_mm, triangles)]
    message.mesh_poses = [Pose()]
    return message


def removed_object(identifier: str) -> Any:
    """`CollisionObject` that removes the object of this identifier; raises `UnknownTypeError`."""
    message = _named(identifier)
    message.operation = message.REMOVE
    return message


def _named(identifier: str) -> Any:
    message = message_type(_TYPE)()
    if not identifier:
        # MoveIt removes all objects if an object to be removed has no identifier.
        raise ConversionError("a collision object has no identifier; expected a name")
    message.id = identifier
    return message
