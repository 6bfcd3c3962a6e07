"""Signed distance of points to a closed mesh, by libigl.

It is independent of `app.fixture`: the distance is libigl's, and the sign comes from libigl's exact
winding number instead of pseudonormals.
"""

import igl
import numpy as np

from app.geometry import FloatArray, SurfaceMesh


def signed_distances_mm(mesh: SurfaceMesh, points_mm: FloatArray) -> FloatArray:
    """The distances (n,) of points (n, 3) in the mesh's frame, negative inside."""
    vertices, faces = np.array(mesh.vertices_mm), mesh.faces.astype(np.int64)
    points = np.ascontiguousarray(points_mm)
    squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    inside = igl.winding_number(vertices, faces, points) > 0.5
    return np.where(inside, -1.0, 1.0) * np.sqrt(squared)
