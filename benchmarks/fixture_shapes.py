"""A tumour and a cautery of any number of triangles for benchmarks and tests, in mm."""

import numpy as np
import trimesh

from app.geometry import SurfaceMesh


def lobed_tumor(triangles: int) -> SurfaceMesh:
    """An irregular tumour with at least ``triangles`` triangles and fewer than 4 times as many."""
    return lobed(max(0, int(np.ceil(np.log(triangles / 20.0) / np.log(4.0)))))


def lobed(subdivisions: int) -> SurfaceMesh:
    """An irregular tumour of about 10 mm radius; a subdivision quadruples the triangles."""
    sphere = trimesh.creation.icosphere(subdivisions, radius=10.0)
    x, y, z = sphere.vertices.T / 10.0
    bumps = 1.0 + 0.18 * np.sin(4.0 * x + 1.0) * np.cos(3.0 * y) + 0.12 * np.sin(5.0 * z)
    shape = trimesh.Trimesh(sphere.vertices * bumps[:, None], sphere.faces, process=False)
    return closed_mesh(shape, "tumor")


def cautery(triangles: int) -> SurfaceMesh:
    """A cautery pencil of 120 mm with a thin tip, of about ``triangles`` similar triangles."""
    around = max(6, int(np.sqrt(triangles / 12.0)))
    along = max(4, int(triangles / (2 * around)))
    height = np.linspace(0.0, 120.0, along)
    radius = np.interp(height, [0.0, 8.0, 14.0, 120.0], [0.4, 0.8, 4.0, 4.5])
    profile = [[0.0, -120.5], *zip(radius[::-1], -height[::-1], strict=True), [0.0, 0.2]]
    return closed_mesh(trimesh.creation.revolve(profile, sections=around), "tool")


def closed_mesh(shape: trimesh.Trimesh, frame: str) -> SurfaceMesh:
    return SurfaceMesh(frame, shape.vertices, shape.faces).require_closed(f"the {frame}")
