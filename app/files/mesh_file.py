"""The one reader of mesh files: STL, OBJ, DAE, GLB, glTF and PLY to one triangle surface.

A scene of several geometries becomes one surface, each geometry at every place that it has. Numbers
are taken as they are written, as RViz and MoveIt do: no up-axis is applied (neither COLLADA's
``up_axis`` nor glTF's y). Node transforms and COLLADA's ``<unit meter=...>`` are applied. Textures
are not read: a textured part has its material's plain colour.

`app.files.meshes` reads the meshes of a case with it, `app.robot.mesh_locator` those of a robot.
"""

import logging
import re
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.files.bounded_io import read_bounded
from app.files.mesh_checks import MeshOptions as MeshOptions
from app.files.mesh_checks import MeshPart, check_obj, check_ply, check_stl, is_binary_stl, placed
from app.geometry import FloatArray, MarginGuardError, weld_vertices


def silence(*libraries: str) -> None:
    """Print nothing that ``libraries`` log, unless the program has configured logging.

    A library that logs a warning prints it otherwise; the error, in one line, is what is printed.
    """
    for name in libraries:
        logger = logging.getLogger(name)
        if not logger.handlers:
            logger.addHandler(logging.NullHandler())


silence("trimesh")

_COMMENT_BYTES = 1000
_STL_HEAD_BYTES = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SPACE = re.compile(rb"SPACE=(\w+)")
_SPACE_SIGNS = {"RAS": (1.0, 1.0, 1.0), "LPS": (-1.0, -1.0, 1.0)}
_GREY = (0.7, 0.7, 0.7, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class FileMesh:
    """Vertices (n, 3) in the file's unit, in m for COLLADA; faces (m, 3); colours (m, 4) or None.

    ``face_colors`` (0 to 1) is None when the file has no colours. A part without colour is grey
    when other parts have one. Corners at the same position are one vertex, and faces that lose a
    corner by that are dropped. Node transforms that mirror keep their normals outward.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    face_colors: FloatArray | None


def read_mesh_file(path: Path, options: MeshOptions, *, scale: float = 1.0) -> FileMesh:
    """Read the mesh file at ``path``; its coordinates are multiplied by ``scale``.

    Raises ``options.error``, in one line, for a file that cannot be read, another format, more
    bytes or triangles than allowed, no triangles, vertices that are not finite and faces of
    missing vertices.
    """
    ending = path.suffix.lower()
    if ending not in options.formats:
        expected = ", ".join(options.formats)
        raise options.error(f"mesh {path} is of an unknown format; expected {expected}")
    try:
        # Numbers that overflow become infinite and are refused below.
        with np.errstate(all="ignore"):
            parts, unit, signs = _read(path, ending, options)
            if parts:
                return _joined(parts, unit * scale * signs, path, options)
    except MarginGuardError:
        raise
    except Exception as problem:  # trimesh's loaders raise exceptions of any type
        reason = str(problem).strip() or type(problem).__name__
        raise options.error(f"mesh {path} cannot be read: {reason}") from problem
    raise options.error(f"mesh {path} holds no triangles")


def _read(
    path: Path, ending: str, options: MeshOptions
) -> tuple[list[MeshPart], float, FloatArray]:
    """Parts of the file in its unit; the unit in metres for COLLADA, else 1; signs of the axes."""
    signs = np.ones(3)
    if ending == ".dae":
        import trimesh

        from app.files.collada import read_collada  # slow to load

        keywords, unit = read_collada(path, options.error, options.max_bytes)
        return _parts(trimesh.load_scene(_unprocessed(keywords)), path, options), unit, signs
    content = read_bounded(path, options.max_bytes, options.error)
    if ending in (".glb", ".gltf"):
        import trimesh

        from app.files.gltf import read_gltf  # slow to load

        keywords = read_gltf(content, path, options)
        return _parts(trimesh.load_scene(_unprocessed(keywords)), path, options), 1.0, signs
    _CHECKS[ending](content, path, options)
    if ending == ".stl" and is_binary_stl(content):
        return _binary_stl(content, path, options), 1.0, _axis_signs(content, path, options)
    import trimesh  # slow to load: not for the formats above

    scene = trimesh.load_scene(_unprocessed(_trimesh_keywords(content, path, options)))
    return _parts(scene, path, options), 1.0, _axis_signs(content, path, options)


_CHECKS = {".stl": check_stl, ".ply": check_ply, ".obj": check_obj}


def _binary_stl(content: bytes, path: Path, options: MeshOptions) -> list[MeshPart]:
    """The triangles of a binary STL, as trimesh reads them."""
    corners = np.frombuffer(content, _STL_TRIANGLE, offset=_STL_HEAD_BYTES)["corners"]
    if len(corners) > options.max_triangles:
        raise options.error(f"mesh {path} has more than {options.max_triangles} triangles")
    if not len(corners):
        return []
    vertices = corners.reshape(-1, 3).astype(np.float64)
    return [(vertices, np.arange(len(vertices)).reshape(-1, 3), None)]


def _trimesh_keywords(content: bytes, path: Path, options: MeshOptions) -> dict[str, Any]:
    """Keywords of `trimesh.load_scene` for the file."""
    from trimesh.exchange.load import mesh_loaders

    from app.files.linked_files import MaterialFiles

    kind = path.suffix.lower().removeprefix(".")
    load: Any = mesh_loaders[kind]
    resolver = MaterialFiles(path) if options.linked_files else None
    # The loader of PLY would open a picture that the file names, and its colours are in the file.
    skips = kind == "ply" or not options.linked_files
    keywords: dict[str, Any] = load(
        BytesIO(content), file_type=kind, resolver=resolver, skip_materials=skips
    )
    return keywords


def _axis_signs(content: bytes, path: Path, options: MeshOptions) -> FloatArray:
    """Signs (3,) from the axes that the file's first bytes name to RAS; 1 where they name none."""
    match = _SPACE.search(content[:_COMMENT_BYTES]) if options.slicer_axes else None
    space = match[1].decode("ascii", "replace") if match else "RAS"
    if space not in _SPACE_SIGNS:
        raise options.error(f"mesh {path} has SPACE={space}; expected RAS or LPS")
    return np.array(_SPACE_SIGNS[space])


def _unprocessed(keywords: dict[str, Any]) -> dict[str, Any]:
    """Disable trimesh's processing, which would drop vertices that are not finite unnoticed."""
    geometries = keywords.get("geometry", {"": keywords})
    for geometry in geometries.values():
        geometry["process"] = False
    return keywords


def _parts(scene: Any, path: Path, options: MeshOptions) -> list[MeshPart]:
    """Vertices, faces and colours of each geometry at each of its places, in the scene's frame."""
    import trimesh

    # trimesh leaves NaN out of a chain of transforms: the part would be at a wrong place.
    edges = scene.graph.transforms.edge_data.values()
    if not all(np.isfinite(edge["matrix"]).all() for edge in edges if "matrix" in edge):
        raise options.error(f"mesh {path} has the transform of a node that is not finite")
    parts: list[MeshPart] = []
    count = 0
    for node in sorted(scene.graph.nodes_geometry):
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            continue
        count += len(geometry.faces)
        if count > options.max_triangles:
            raise options.error(f"mesh {path} has more than {options.max_triangles} triangles")
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        faces = np.asarray(geometry.faces, dtype=np.int64)
        parts.append(placed(vertices, faces, _face_colors(geometry), matrix))
    return parts


def _check_part(part: MeshPart, path: Path, options: MeshOptions) -> None:
    vertices, faces, _ = part
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise options.error(
            f"mesh {path} has vertices of {vertices.shape[1:]} coordinates and faces of "
            f"{faces.shape[1:]} corners; expected 3"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise options.error(f"mesh {path} has faces of vertices that it does not hold")


def _joined(
    parts: list[MeshPart], factors: FloatArray, path: Path, options: MeshOptions
) -> FileMesh:
    """One surface of all ``parts``, with coordinates multiplied by ``factors`` (3,)."""
    for part in parts:
        _check_part(part, path, options)
    # + 0.0: no negative zeros.
    vertices = np.concatenate([part[0] for part in parts]) * factors + 0.0
    offsets = np.cumsum([0, *(len(part[0]) for part in parts)])
    faces = np.concatenate(
        [part[1] + offset for part, offset in zip(parts, offsets[:-1], strict=True)]
    )
    is_finite = np.isfinite(vertices).all(axis=1)
    if not is_finite.all():
        first = int(np.argmin(is_finite))
        raise options.error(
            f"mesh {path}: vertex {first} is {vertices[first].tolist()}; expected finite numbers "
            f"({int((~is_finite).sum())} of {len(vertices)} vertices are not finite)"
        )
    vertices, faces, kept = weld_vertices(vertices, faces)
    if len(faces) == 0:
        raise options.error(f"mesh {path} holds no triangles with an area")
    return FileMesh(vertices, faces, _joined_colors(parts, kept))


def _face_colors(geometry: Any) -> FloatArray | None:
    visual, count = geometry.visual, len(geometry.faces)
    if not visual.defined:
        return None
    if visual.kind == "texture":
        color = np.asarray(visual.material.main_color, dtype=np.float64) / 255.0
        return np.tile(color, (count, 1))
    return np.asarray(visual.face_colors, dtype=np.float64).reshape(count, -1) / 255.0


def _joined_colors(parts: list[MeshPart], kept: NDArray[np.bool_]) -> FloatArray | None:
    if all(colors is None for _, _, colors in parts):
        return None
    colors = [np.tile(_GREY, (len(faces), 1)) if c is None else c for _, faces, c in parts]
    joined = np.concatenate(colors)[kept]
    return np.asarray(joined, dtype=np.float64)
