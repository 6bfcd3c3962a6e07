"""Closed tumour and tool meshes for tests of the fixture, in mm."""

import numpy as np
import trimesh

from app.geometry import SurfaceMesh
from benchmarks.fixture_shapes import closed_mesh, lobed

TUMORS = ("ball", "lobed", "two_part", "thin_shell", "spiky")
TOOLS = ("needle", "bracket", "hollow_block", "forceps")


def tumor(kind: str, subdivisions: int = 3) -> SurfaceMesh:
    """A tumour of about 10 mm radius; each subdivision quadruples the number of triangles."""
    if kind == "lobed":
        return lobed(subdivisions)
    return closed_mesh(_tumor(kind, subdivisions), "tumor")


def tool(kind: str, fineness: int = 12) -> SurfaceMesh:
    """A tool; the needle fits inside the tumours, and the tumours inside the hollow block."""
    return closed_mesh(_tool(kind, fineness), "tool")


def _tumor(kind: str, subdivisions: int) -> trimesh.Trimesh:
    sphere = trimesh.creation.icosphere(subdivisions, radius=10.0)
    x, y, z = sphere.vertices.T / 10.0
    if kind == "ball":
        return sphere
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
