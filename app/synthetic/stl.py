"""Writes binary STL; the same surface gives the same bytes."""

from pathlib import Path

import numpy as np

from app.geometry import SurfaceMesh

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = b"binary STL, mm".ljust(80)


def write_stl(path: Path, mesh: SurfaceMesh) -> None:
    """Write ``mesh`` to ``path`` in mm, single precision, with the normals of its faces."""
    corners = mesh.triangles_mm
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facets["corners"] = corners
    path.write_bytes(_HEADER + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes())
