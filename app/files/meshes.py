"""Surface files of cases (STL, PLY, OBJ) as `SurfaceMesh`, in mm.

3D Slicer writes models in LPS axes, with ``SPACE=LPS`` in the file: x and y of such a file are
negated on reading. A file without this comment is read as it is. Files written here have
``SPACE=RAS``, so that Slicer does not negate x and y.
"""

from pathlib import Path

import numpy as np

from app.files.atomic_io import check_output_path, write_file
from app.files.keys import Choice
from app.files.mesh_file import MeshOptions, read_mesh_file
from app.geometry import InputError, MeshError, SurfaceMesh

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Millimetres per unit of a mesh file."""

MESH_PATH = "mesh file (.stl, .ply, .obj), relative, absolute or package://NAME/..."
MESH_UNITS = Choice("unit of the file's coordinates", tuple(UNITS_MM))
"""Path and unit of a mesh, the same in ``case.yaml`` and ``world.yaml``."""

MESH_ENDINGS = (".stl", ".ply", ".obj")
"""Endings of the files that can be read."""

_WRITABLE = (".stl", ".ply")
_MAX_BYTES = 80 * 1024 * 1024
_OPTIONS = MeshOptions(
    formats=MESH_ENDINGS, max_bytes=_MAX_BYTES, max_triangles=_MAX_BYTES, slicer_axes=True
)
"""No linked files: a mesh of a case cannot read other files. No format here repeats a part, so the
bound on bytes also bounds the triangles."""

_STL_HEADER = b"MarginGuard, binary STL, mm. SPACE=RAS".ljust(80)
_PLY_COMMENT = b"comment MarginGuard, mm\ncomment SPACE=RAS\n"


def load_mesh(path: Path, *, units: str, frame: str) -> SurfaceMesh:
    """Read the surface at ``path``, given in ``units``, as a mesh in ``frame``.

    Vertices at the same position become one (STL repeats them in every face), and faces that lose
    a corner by that are dropped. Nothing else is repaired. Raises `MeshError` for a file that
    cannot be read, another format, and vertices that are not finite.
    """
    if units not in UNITS_MM:
        raise MeshError(f"units of {path} are {units!r}; expected one of {', '.join(UNITS_MM)}")
    mesh = read_mesh_file(path, _OPTIONS, scale=UNITS_MM[units])
    return SurfaceMesh(frame, mesh.vertices, mesh.faces.astype(np.int32))


def check_mesh_path(path: Path) -> None:
    """Raise `InputError` unless a mesh can be written to ``path``; call it before long work."""
    if path.suffix.lower() not in _WRITABLE:
        raise InputError(f"{path} is not a mesh file; expected {' or '.join(_WRITABLE)}")
    check_output_path(path)


def write_exact_ply(path: Path, mesh: SurfaceMesh) -> None:
    """Write ``mesh`` to ``path`` as PLY atomically, in mm; reading it gives the same coordinates.

    Raises `InputError` for a path that cannot be written.
    """
    check_output_path(path)
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = (
        b"ply\nformat binary_little_endian 1.0\n%selement vertex %d\nproperty double x\n"
        b"property double y\nproperty double z\nelement face %d\n"
        b"property list uchar int vertex_indices\nend_header\n"
    ) % (_PLY_COMMENT, len(mesh.vertices_mm), len(faces))
    write_file(path, header + mesh.vertices_mm.astype("<f8").tobytes() + faces.tobytes())


def write_mesh(path: Path, mesh: SurfaceMesh) -> None:
    """Write ``mesh`` to ``path`` (``.stl``, ``.ply``) atomically, in mm and single precision.

    Raises `InputError` for another ending and a path that cannot be written.
    """
    check_mesh_path(path)
    import trimesh  # slow to load
    from trimesh.exchange.ply import export_ply
    from trimesh.exchange.stl import export_stl

    surface = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    if path.suffix.lower() == ".stl":
        content = _STL_HEADER + export_stl(surface)[len(_STL_HEADER) :]
    else:
        magic, form, rest = export_ply(surface).split(b"\n", 2)
        content = b"\n".join([magic, form, _PLY_COMMENT + rest])
    write_file(path, content)
