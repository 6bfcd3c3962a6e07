"""One part of a mesh file at one of its places."""

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray

MeshPart = tuple[FloatArray, NDArray[np.int64], FloatArray | None]
"""Vertices (n, 3), faces (m, 3), and colours of the faces (m, 4) from 0 to 1 or None."""


def placed(
    vertices: FloatArray, faces: NDArray[np.int64], colors: FloatArray | None, matrix: FloatArray
) -> MeshPart:
    """Return the part at ``matrix`` (4, 4). Mirroring keeps the normals outward."""
    if not np.array_equal(matrix, np.eye(4)):
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
    return vertices, faces, colors
