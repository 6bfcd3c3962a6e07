"""Independent oracle of a needle's distance to a structure: coal's capsules, and solid angles.

It uses none of the code of `app.fixture` and `app.planning`.
"""

import coal
import numpy as np

from app.geometry import FloatArray, SurfaceMesh
from benchmarks.fixture.engines import coal_model


class NeedleOracle:
    """Distance of a needle to one closed structure."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        self._corners = mesh.triangles_mm
        self._model = coal_model(mesh.vertices_mm, mesh.faces)
        self._at = coal.Transform3s()
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()

    def clearance(self, start: FloatArray, end: FloatArray, radius: float) -> float:
        """Distance of a needle from the shell; not above 0 where it meets the shell."""
        axis = end - start
        length = float(np.linalg.norm(axis))
        z = axis / length
        x, y = np.linalg.svd(z[None])[2][1:]
        if np.linalg.det(np.column_stack([x, y, z])) < 0.0:
            x = -x
        pose = coal.Transform3s(np.column_stack([x, y, z]), 0.5 * (start + end))
        self._result.clear()
        capsule = coal.Capsule(radius, length)
        return coal.distance(capsule, pose, self._model, self._at, self._request, self._result)

    def contains(self, point: FloatArray) -> bool:
        """True if a point is inside, by the solid angle of all triangles."""
        a, b, c = np.moveaxis(self._corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        angle = 2.0 * np.arctan2((a * np.cross(b, c)).sum(1), below)
        return bool(angle.sum() > 2.0 * np.pi)
