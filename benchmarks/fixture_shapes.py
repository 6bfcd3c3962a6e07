"""Closed tumour and tool meshes for tests and benchmarks of the fixture, in mm."""

import numpy as np
import trimesh

from app.geometry import SurfaceMesh

TUMORS = ("ball", "lobed", "two_part", "thin_shell", "spiky")
TOOLS = ("needle", "bracket", "hollow_block", "forceps")


def tumor(kind: str, subdivisions: int = 3) -> SurfaceMesh:
    """A tumour of about 10 mm radius; each subdivision quadruples the number of triangles."""
    return _mesh(_tumor(kind, subdivisions), "tumor")


def tool(kind: str, fineness: int = 12) -> SurfaceMesh:
    """A tool; the needle fits inside the tumours, and the tumours inside the hollow block."""
    return _mesh(_tool(kind, fineness), "tool")


def lobed_tumor(triangles: int) -> SurfaceMesh:
    """An irregular tumour with at least ``triangles`` triangles and fewer than 4 times as many."""
    subdivisions = max(0, int(np.ceil(np.log(triangles / 20.0) / np.log(4.0))))
    return tumor("lobed", subdivisions)


def cautery(triangles: int) -> SurfaceMesh:
    """A cautery pencil of 120 mm with a thin tip, of about ``triangles`` similar triangles."""
    around = max(6, int(np.sqrt(triangles / 12.0)))
    along = max(4, int(triangles / (2 * around)))
    height = np.linspace(0.0, 120.0, along)
    radius = np.interp(height, [0.0, 8.0, 14.0, 120.0], [0.4, 0.8, 4.0, 4.5])
    profile = [[0.0, -120.5], *zip(radius[::-1], -height[::-1], strict=True), [0.0, 0.2]]
    return _mesh(trimesh.creation.revolve(profile, sections=around), "tool")


def _tumor(kind: str, subdivisions: int) -> trimesh.Trimesh:
    sphere = trimesh.creation.icosphere(subdivisions, radius=10.0)
    x, y, z = sphere.vertices.T / 10.0
    if kind == "ball":
        return sphere
    if kind == "lobed":
        bumps = 1.0 + 0.18 * np.sin(4.0 * x + 1.0) * np.cos(3.0 * y) + 0.12 * np.sin(5.0 * z)
        return trimesh.Trimesh(sphere.vertices * bumps[:, None], sphere.faces, process=False)
    if kind == "spiky":
        spikes = (
            1.0 + 0.6 * np.maximum(0.0, np.cos(6.0 * x) * np.cos(6.0 * y) * np.cos(6.0 * z)) ** 3
        )
        return trimesh.Trimesh(sphere.vertices * spikes[:, None], sphere.faces, process=False)
    if kind == "two_part":
        first, second = sphere.copy(), sphere.copy()
        first.apply_scale(0.5)
        second.apply_scale(0.35)
        first.apply_translation([-6.0, 0.0, 0.0])
        second.apply_translation([5.0, 2.0, 0.0])
        return trimesh.util.concatenate([first, second])
    if kind == "thin_shell":
        cavity = sphere.copy()
        cavity.apply_scale(0.9)
        cavity.invert()
        return trimesh.util.concatenate([sphere, cavity])
    raise ValueError(f"kind of tumour is {kind!r}; expected {', '.join(TUMORS)}")


def _tool(kind: str, fineness: int) -> trimesh.Trimesh:
    if kind == "needle":
        return trimesh.creation.capsule(height=6.0, radius=0.8, count=[fineness, fineness])
    if kind == "bracket":
        profile = np.array([[0, 0], [30, 0], [30, 3], [3, 3], [3, 15], [0, 15]], dtype=float)
        fan = [[0, k, k + 1] for k in range(1, len(profile) - 1)]
        return trimesh.creation.extrude_triangulation(profile, fan, 4.0)
    if kind == "hollow_block":
        block = trimesh.creation.box(extents=[60.0, 60.0, 60.0]).subdivide().subdivide()
        cavity = trimesh.creation.icosphere(2, radius=12.0)
        cavity.apply_translation([14.0, 14.0, 14.0])
        cavity.invert()
        return trimesh.util.concatenate([block, cavity])
    if kind == "forceps":
        first = trimesh.creation.capsule(height=30.0, radius=1.0, count=[fineness, fineness])
        second = first.copy()
        second.apply_translation([7.0, 0.0, 0.0])
        return trimesh.util.concatenate([first, second])
    raise ValueError(f"kind of tool is {kind!r}; expected {', '.join(TOOLS)}")


def _mesh(shape: trimesh.Trimesh, frame: str) -> SurfaceMesh:
    return SurfaceMesh(frame, shape.vertices, shape.faces).require_closed(f"the {frame}")
