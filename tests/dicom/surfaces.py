"""Closed surfaces with a known volume."""

import numpy as np
import trimesh

from app.geometry import SurfaceMesh


def ball(radius_mm: float, centre_mm: tuple[float, float, float]) -> SurfaceMesh:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_mm)
    return SurfaceMesh("tumor", mesh.vertices + centre_mm, mesh.faces)


def shell(outer_mm: float, inner_mm: float, centre_mm: tuple[float, float, float]) -> SurfaceMesh:
    """A ball with a hollow, and a smaller ball within the hollow."""
    outside, hollow = ball(outer_mm, centre_mm), ball(inner_mm, centre_mm)
    core = ball(inner_mm / 2.0, centre_mm)
    number = len(outside.vertices_mm)
    return SurfaceMesh(
        "tumor",
        np.concatenate([outside.vertices_mm, hollow.vertices_mm, core.vertices_mm]),
        np.concatenate([outside.faces, hollow.faces[:, ::-1] + number, core.faces + 2 * number]),
    )
