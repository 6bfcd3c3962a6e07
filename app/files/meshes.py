"""Surface files (STL, PLY, OBJ) as `SurfaceMesh`, in mm.

3D Slicer writes models in LPS axes and says so in the file (``SPACE=LPS``): the x and y of such a
file are turned around here. A file that does not say is taken as it is. What is written here says
``SPACE=RAS``, without which Slicer would turn it.
"""

import re
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.ply import export_ply
from trimesh.exchange.stl import export_stl

from app.files.bounded_io import check_place, write_small
from app.geometry import FloatArray, InputError, MeshError, SurfaceMesh, weld_vertices

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Millimetres in each unit that a mesh may be given in."""

MESH_ENDINGS = (".stl", ".ply", ".obj")
"""Files that can be read."""

_WRITABLE = (".stl", ".ply")
_MAX_BYTES = 512_000_000
_SPACE = re.compile(rb"SPACE=(\w+)")
_COMMENT_BYTES = 1000
_AXES = {"RAS": (1.0, 1.0, 1.0), "LPS": (-1.0, -1.0, 1.0)}
_STL_HEADER = b"MarginGuard, binary STL, mm. SPACE=RAS".ljust(80)
_PLY_COMMENT = b"comment MarginGuard, mm\ncomment SPACE=RAS\n"


def load_mesh(path: Path, *, units: str, frame: str) -> SurfaceMesh:
    """Read the surface at ``path``, given in ``units``, as a mesh in ``frame``.

    Vertices at the very same place become one (STL repeats them in every face) and faces that lose
    a corner by that go; nothing else is repaired. Raises `MeshError` for a file that cannot be
    read, another format, and vertices that are not finite.
    """
    if units not in UNITS_MM:
        raise MeshError(f"units {units!r} of {path} are not known: {', '.join(UNITS_MM)} allowed")
    suffix = path.suffix.lower()
    if suffix not in MESH_ENDINGS:
        raise MeshError(f"{path} is no mesh that can be read: {', '.join(MESH_ENDINGS)} allowed")
    vertices, faces = _read(path, suffix)
    if not len(faces):
        raise MeshError(f"{path} holds no triangle: a surface wanted")
    try:
        raw = SurfaceMesh(frame, vertices * UNITS_MM[units], faces)
        places, whole, _ = weld_vertices(raw.vertices_mm + 0.0, raw.faces)  # + 0.0: no -0.0
        return SurfaceMesh(frame, places, whole.astype(np.int32))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def check_mesh_place(path: Path) -> None:
    """Raise `InputError` unless a mesh can be written to ``path``: ask before the work is done."""
    if path.suffix.lower() not in _WRITABLE:
        raise InputError(f"{path}: a mesh is written as {' or '.join(_WRITABLE)}")
    check_place(path)


def write_mesh(path: Path, mesh: SurfaceMesh) -> None:
    """Put ``mesh`` at ``path`` (``.stl``, ``.ply``), in mm and single precision.

    Whole or not at all. Raises `InputError` for another ending and a place that is none.
    """
    check_mesh_place(path)
    surface = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    if path.suffix.lower() == ".stl":
        content = _STL_HEADER + export_stl(surface)[len(_STL_HEADER) :]
    else:
        magic, form, rest = export_ply(surface).split(b"\n", 2)
        content = b"\n".join([magic, form, _PLY_COMMENT + rest])
    write_small(path, content)


def _axes(start: bytes, path: Path) -> FloatArray:
    """The signs (3,) that turn the axes which the file's first bytes name, if any, to RAS."""
    match = _SPACE.search(start)
    space = match[1].decode("ascii", "replace") if match else "RAS"
    if space not in _AXES:
        raise MeshError(f"{path} says SPACE={space}: RAS or LPS wanted")
    return np.array(_AXES[space])


def _read(path: Path, suffix: str) -> tuple[FloatArray, NDArray[Any]]:
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise MeshError(f"{path} has more than the {_MAX_BYTES} bytes allowed")
        signs = _axes(content[:_COMMENT_BYTES], path)
        # From its bytes, which have no folder: the file cannot pull in others then. Without
        # trimesh's processing, which would drop faces with NaN and hide that the file is broken.
        loaded = trimesh.load_mesh(
            BytesIO(content), file_type=suffix[1:], process=False, skip_materials=True
        )
        return np.asarray(loaded.vertices, dtype=np.float64) * signs, np.asarray(loaded.faces)
    except OSError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}") from error
    except MeshError:
        raise
    except Exception as error:  # trimesh's parsers fail with whatever their helpers raise
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise MeshError(f"{path} is no readable {suffix[1:].upper()} file: {reason}") from error
