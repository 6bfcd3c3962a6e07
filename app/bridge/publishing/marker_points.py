"""Triangles of markers, written as bytes: converting a `Point` each would hold the GIL for long."""

import struct
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from visualization_msgs.msg import MarkerArray

from app.bridge.errors import BridgeError
from app.bridge.messages import metres
from app.geometry import FloatArray, SurfaceMesh

MAX_TRIANGLES = 25_000
"""A marker with more is simplified: it is sent at each change of colour, 72 bytes a triangle."""

_COARSER = 1.15

_MAX_CELLS = 2000
"""Along the longest side, also where the area is nearly 0, so that the steps to it are few."""


def placeholder(number: int) -> Point:
    """The only point of marker ``number`` of an array, for `serialized`."""
    return Point(x=-1.5e300, y=2.5e299, z=1e298 * (number + 1))


def serialized(markers: MarkerArray, points_m: Sequence[FloatArray]) -> bytes:
    """``markers`` with ``points_m`` (k, 3) in place of the `placeholder` of each, serialised.

    In CDR the points follow their number without padding, because three doubles, four floats, two
    integers and one byte come before.
    """
    rest, done = bytes(serialize_message(markers)), b""
    for number, points in enumerate(points_m):
        point = placeholder(number)
        before, mark, rest = rest.partition(struct.pack("<3d", point.x, point.y, point.z))
        if not mark or before[-4:] != struct.pack("<I", 1):
            raise BridgeError(
                f"marker {number}: its points are not where they were expected in the message; "
                "expected the definition of visualization_msgs of ROS 2 Jazzy"
            )
        coordinates = np.ascontiguousarray(points, dtype="<f8")
        done += before[:-4] + struct.pack("<I", len(coordinates)) + coordinates.tobytes()
    return done + rest


def corners_m(mesh: SurfaceMesh) -> FloatArray:
    """Corners (3 m, 3) of the faces in sequence, in m, of at most `MAX_TRIANGLES` faces."""
    vertices: FloatArray = mesh.vertices_mm
    faces: NDArray[np.integer] = mesh.faces
    if len(faces) > MAX_TRIANGLES:
        vertices, faces = simplified(vertices, faces, MAX_TRIANGLES)
    return np.asarray(metres(vertices[faces.reshape(-1)]))


def simplified(
    vertices: FloatArray, faces: NDArray[np.integer], max_faces: int
) -> tuple[FloatArray, NDArray[np.integer]]:
    """A coarser surface with at most ``max_faces`` faces, for display only.

    Vertices in one cell of a grid are replaced by their mean, and faces that degenerate are
    dropped (Rossignac and Borrel 1993): no vertex moves by more than the diagonal of a cell.
    """
    # `take` and `compress` release the GIL, indexing by an array does not.
    a, b, c = (np.take(vertices, faces[:, k], axis=0) for k in range(3))
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    low = vertices.min(axis=0)
    side = float((vertices.max(axis=0) - low).max())
    cell = max(np.sqrt(2.0 * area / max_faces), side / _MAX_CELLS, 1e-9)
    while True:
        cells = ((vertices - low) / cell).astype(np.int64)
        size = cells.max(axis=0) + 1
        key = (cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2]
        _, index, count = np.unique(key, return_inverse=True, return_counts=True)
        merged = np.take(index, faces)
        first, second, third = merged.T
        distinct = (first != second) & (second != third) & (third != first)
        kept = np.compress(distinct, merged, axis=0)
        if len(kept) <= max_faces:
            sums = [np.bincount(index, weights=vertices[:, axis]) for axis in range(3)]
            return np.stack(sums, axis=1) / count[:, None], kept
        cell *= _COARSER
