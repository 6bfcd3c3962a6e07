"""Whether points are inside a mesh, and their signed distances, by libigl.

Independent of `app.fixture` (FCL and signed fields), of `app.synthetic.truth` (the tumour's
radius function) and of `app.case.tumor` (convex hulls and marching cubes). Methods: generalised
winding numbers (Jacobson et al. 2013) and fast winding numbers (Barill et al. 2018).
"""

import igl
import numpy as np

from app.geometry import FloatArray, SurfaceMesh


def any_point_inside(points_mm: FloatArray, mesh: SurfaceMesh) -> bool:
    """True if one of ``points_mm`` (n, 3), in the frame of ``mesh``, is inside ``mesh``."""
    winding = igl.fast_winding_number(mesh.vertices_mm, mesh.faces.astype(np.int64), points_mm)
    return bool((winding > 0.5).any())


def signed_distances_mm(mesh: SurfaceMesh, points_mm: FloatArray) -> FloatArray:
    """The distances (n,) of points (n, 3) in the mesh's frame, negative inside."""
    vertices, faces = np.array(mesh.vertices_mm), mesh.faces.astype(np.int64)
    points = np.ascontiguousarray(points_mm)
    squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    inside = igl.winding_number(vertices, faces, points) > 0.5
    return np.where(inside, -1.0, 1.0) * np.sqrt(squared)


def depths_mm(mesh: SurfaceMesh, points_mm: FloatArray) -> FloatArray:
    """Depth (n,) of ``points_mm`` (n, 3) below the surface of ``mesh``; negative outside."""
    return -signed_distances_mm(mesh, points_mm)
