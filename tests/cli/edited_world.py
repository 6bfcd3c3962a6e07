"""A world for tests of edits: the shipped one, with a stone on a table beside it."""

import shutil
from pathlib import Path

import numpy as np

from app.files.meshes import write_mesh
from app.geometry import SurfaceMesh
from app.robot.primitives import box

TABLE_TOP_MM, STONE_MM = 5.0, 20.0

BODIES = """bodies:
  - {name: table, motion: fixed, position_mm: [205, 150, 0], mesh: {path: table.stl, units: mm}}
  - name: stone
    motion: free
    mass_kg: 0.05
    position_mm: [205, 150, 15.5]
    mesh: {path: stone.stl, units: mm}
"""


def write_edited_world(shipped: Path, folder: Path) -> Path:
    """Copy the world at ``shipped`` to ``folder``; coarser steps and older poses, for two cores
    that also draw a page and run a browser."""
    shutil.copytree(shipped, folder)
    for name, size in (("table", (120, 120, 10)), ("stone", [STONE_MM] * 3)):
        vertices, faces = box(size)
        write_mesh(folder / f"{name}.stl", SurfaceMesh(name, vertices, faces.astype(np.int32)))
    file = folder / "world.yaml"
    text = file.read_text().replace("seed: 20\n", "seed: 20\nphysics: {timestep_ms: 2}\n")
    file.write_text(text.replace("bodies:\n", BODIES))
    live = folder / "live.yaml"
    live.write_text(live.read_text().replace("stale_after_ms: 100", "stale_after_ms: 300"))
    return folder
