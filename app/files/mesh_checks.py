"""Parts and options of a mesh file, and the checks of its values."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.geometry import FloatArray, MarginGuardError, MeshError


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """Options of a caller for reading mesh files: accepted formats, limits, axes.

    ``formats``
        Accepted endings, in lower case, with the dot.
    ``max_triangles``
        Limit over all parts at all places: a file may place one part many times.
    ``linked_files``
        Whether materials and buffers in files beside the mesh are read.
    ``slicer_axes``
        Whether a comment ``SPACE=LPS``, which 3D Slicer writes, turns x and y around.
    ``error``
        Type of the error that is raised.
    """

    formats: tuple[str, ...]
    max_bytes: int
    max_triangles: int
    linked_files: bool = False
    slicer_axes: bool = False
    error: type[MarginGuardError] = MeshError


MAX_TEXT_BYTES = 64 * 1024 * 1024
"""Limit for a mesh given as text, which takes up to twelve times its size in memory."""

MAX_PARTS = 1000
"""Limit for the solids of an ASCII STL and for the materials that an OBJ uses."""

_MAX_HEADER_BYTES = 65_536
_MAX_HEADER_LINES = 500
_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 84, 50
_ELEMENT = re.compile(rb"element\s+(\S+)\s+(\S+)")
_MATERIAL = re.compile(rb"^[ \t]*usemtl[ \t]+([^\r\n]*)", re.MULTILINE)


def check_stl(content: bytes, path: Path, options: MeshOptions) -> None:
    """Refuse an STL that is neither binary nor complete text, and one of too many solids."""
    if is_binary_stl(content):
        return
    count = int.from_bytes(content[80:84], "little")
    text = content.rstrip().lower()
    if not text.lstrip().startswith(b"solid"):
        raise options.error(
            f"mesh {path} is not an STL: it has {len(content)} bytes; expected "
            f"{_STL_HEADER_BYTES + _STL_TRIANGLE_BYTES * count} for the {count} triangles of its "
            "header, or a text that begins with 'solid'"
        )
    if not text[text.rfind(b"\n") + 1 :].lstrip().startswith(b"endsolid"):
        raise options.error(f"mesh {path} does not end with 'endsolid'; expected the whole text")
    _check_text(content, path, options)
    _check_parts(text.count(b"endsolid"), "solids", path, options)


def is_binary_stl(content: bytes) -> bool:
    """True if the file has the length of a binary STL of as many triangles as its header says."""
    count = int.from_bytes(content[80:84], "little")
    return len(content) == _STL_HEADER_BYTES + _STL_TRIANGLE_BYTES * count


def check_ply(content: bytes, path: Path, options: MeshOptions) -> None:
    """Refuse a PLY whose header is long, or declares more elements than the file has bytes."""
    header, end, _ = content[:_MAX_HEADER_BYTES].partition(b"end_header")
    if not content.startswith(b"ply") or not end:
        raise options.error(f"mesh {path} is not a PLY: it has no header that ends")
    lines = header.count(b"\n")
    if lines > _MAX_HEADER_LINES:
        raise options.error(
            f"mesh {path} has a header of {lines} lines; expected at most {_MAX_HEADER_LINES}"
        )
    left = len(content) - len(header) - len(end)
    for name, count in _ELEMENT.findall(header):
        if not count.isdigit() or int(count[:20]) > left:
            raise options.error(
                f"mesh {path} declares {count[:40].decode('ascii', 'replace')} elements "
                f"{name[:40].decode('ascii', 'replace')!r}; expected at most {left}, its bytes"
            )
    if b"ascii" in header[:80]:
        _check_text(content, path, options)


def check_obj(content: bytes, path: Path, options: MeshOptions) -> None:
    """Refuse an OBJ of too many materials."""
    _check_text(content, path, options)
    _check_parts(len(set(_MATERIAL.findall(content))), "materials", path, options)


def _check_text(content: bytes, path: Path, options: MeshOptions) -> None:
    if len(content) > MAX_TEXT_BYTES:
        raise options.error(
            f"mesh {path} has {len(content)} bytes of text; expected at most {MAX_TEXT_BYTES}: "
            "save it as a binary file"
        )


def _check_parts(count: int, what: str, path: Path, options: MeshOptions) -> None:
    if count > MAX_PARTS:
        raise options.error(f"mesh {path} has {count} {what}; expected at most {MAX_PARTS}")


MeshPart = tuple[FloatArray, NDArray[np.int64], FloatArray | None]
"""Vertices (n, 3), faces (m, 3), and colours of the faces (m, 4) from 0 to 1 or None."""


def placed(
    vertices: FloatArray, faces: NDArray[np.int64], colors: FloatArray | None, matrix: FloatArray
) -> MeshPart:
    """Return the part at ``matrix`` (4, 4). Mirroring keeps the normals outward."""
    if not np.array_equal(matrix, np.eye(4)):
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
    return vertices, faces, colors
