"""Whether points are inside a mesh, and how deep, by winding numbers (libigl).

Independent of `app.fixture` (FCL and signed fields), of `app.synthetic.clearance` (the tumour's
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


def depths_mm(mesh: SurfaceMesh, points_mm: FloatArray) -> FloatArray:
    """Depth (n,) of ``points_mm`` (n, 3) below the surface of ``mesh``; negative outside."""
    vertices, faces = np.array(mesh.vertices_mm), np.array(mesh.faces)
    squared = igl.point_mesh_squared_distance(points_mm, vertices, faces)[0]
    inside = igl.winding_number(vertices, faces, points_mm) > 0.5
    return np.where(inside, 1.0, -1.0) * np.sqrt(squared)
