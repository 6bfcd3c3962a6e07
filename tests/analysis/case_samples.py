"""Samples of made-up cases, of which only the tip's poses are known."""

import numpy as np
import trimesh

from app.analysis import CaseSamples
from app.geometry import SurfaceMesh


def samples(tips, rotations=None, *, gap_at=None):
    """Poses at 50 Hz; before ``gap_at`` a second is missing."""
    count = len(tips)
    stamps = np.arange(count, dtype=np.int64) * 20_000_000
    if gap_at is not None:
        stamps[gap_at:] += 1_000_000_000
    unknown = np.full((count, 3), np.nan)
    return CaseSamples(
        stamps_ns=stamps,
        states=np.zeros(count, dtype=np.int8),
        distances_mm=np.zeros(count),
        stop_mm=np.zeros(count),
        tips_mm=tips,
        rotations=np.tile(np.eye(3), (count, 1, 1)) if rotations is None else rotations,
        on_tumor_mm=unknown,
        on_tool_mm=unknown,
        normals=unknown,
        between=np.zeros(count, dtype=bool),
    )


def mesh(shape: trimesh.Trimesh, frame: str = "tumor", at: tuple[float, ...] = ()) -> SurfaceMesh:
    return SurfaceMesh(frame, shape.vertices + (np.array(at) if at else 0.0), shape.faces)
