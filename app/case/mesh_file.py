"""Surface files (STL, PLY, OBJ) as `SurfaceMesh`, in mm."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from app.geometry import FloatArray, MeshError, SurfaceMesh

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Millimetres in each unit that a mesh may be given in."""

_FORMATS = (".stl", ".ply", ".obj")
_MAX_BYTES = 512_000_000


def load_mesh(path: Path, *, units: str, frame: str) -> SurfaceMesh:
    """Read the surface at ``path``, given in ``units``, as a mesh in ``frame``.

    Vertices at the very same place become one (STL repeats them in every face) and faces that lose
    a corner by that go; nothing else is repaired. Raises `MeshError` for a file that cannot be
    read, another format, and vertices that are not finite.
    """
    if units not in UNITS_MM:
        raise MeshError(f"units {units!r} of {path} are not known: {', '.join(UNITS_MM)} allowed")
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        raise MeshError(f"{path} is no mesh that can be read: {', '.join(_FORMATS)} allowed")
    vertices, faces = _read(path, suffix)
    try:
        raw = SurfaceMesh(frame, vertices * UNITS_MM[units], faces)
        places, index = np.unique(raw.vertices_mm + 0.0, axis=0, return_inverse=True)
        merged = index.reshape(-1)[raw.faces]
        whole = (merged != np.roll(merged, 1, axis=1)).all(axis=1)
        return SurfaceMesh(frame, places, merged[whole])
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error


def _read(path: Path, suffix: str) -> tuple[FloatArray, NDArray[Any]]:
    try:
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise MeshError(f"{path} has {size} bytes: at most {_MAX_BYTES} allowed")
        # From an open file, not from the path: an OBJ cannot pull in other files then. Without
        # trimesh's processing, which would drop faces with NaN and hide that the file is broken.
        with path.open("rb") as file:
            loaded = trimesh.load_mesh(file, file_type=suffix[1:], process=False)
        return np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces)
    except OSError as error:
        raise MeshError(f"{path} cannot be read: {error.strerror}") from error
    except MeshError:
        raise
    except Exception as error:  # trimesh's parsers fail with whatever their helpers raise
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise MeshError(f"{path} is no readable {suffix[1:].upper()} file: {reason}") from error
