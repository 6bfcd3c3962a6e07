"""Whether a tool is inside a tumour, by the winding number of the tumour's mesh (libigl).

Independent of `app.synthetic.clearance`, which uses the tumour's radius function, and of
`app.fixture`, which uses FCL and signed fields. Method: fast winding numbers (Barill et al. 2018).
"""

import igl
import numpy as np

from app.geometry import FloatArray, SurfaceMesh


def any_point_inside(points_mm: FloatArray, mesh: SurfaceMesh) -> bool:
    """True if one of ``points_mm`` (n, 3), in the frame of ``mesh``, is inside ``mesh``."""
    winding = igl.fast_winding_number(mesh.vertices_mm, mesh.faces.astype(np.int64), points_mm)
    return bool((winding > 0.5).any())
