"""Collision objects of MoveIt from triangle meshes in mm."""

from typing import Any

import numpy as np
from geometry_msgs.msg import Pose
from numpy.typing import ArrayLike
from shape_msgs.msg import Mesh, MeshTriangle

from app.bridge.convert.errors import ConversionError
from app.bridge.convert.types import message_type
from app.bridge.messages import point_message, quaternion_message
from app.geometry import Transform

_TYPE = "moveit_msgs/msg/CollisionObject"


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
