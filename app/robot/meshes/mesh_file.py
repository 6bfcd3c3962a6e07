"""Mesh files of robots: STL, OBJ, DAE, GLB, glTF and PLY to one triangle surface.

Numbers are taken as they stand, as RViz and MoveIt take them: no up-axis is applied (neither
COLLADA's ``up_axis`` nor glTF's y), node transforms are, and so is COLLADA's ``<unit meter=...>``.
A scene of several geometries becomes one surface. Textures are not read: a textured part has its
material's plain colour.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.load import mesh_loaders
from trimesh.resolvers import FilePathResolver

from app.geometry import FloatArray, weld_vertices
from app.robot.errors import RobotMeshError

FORMATS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply")
MAX_FILE_BYTES = 256 * 1024 * 1024
MAX_TRIANGLES = 10_000_000
"""Of all parts at all their places: a file may place one part as often as it likes."""


@dataclass(frozen=True, slots=True, eq=False)
class FileMesh:
    """Vertices (n, 3) in the file's unit, made metres for COLLADA; faces (m, 3); colours (m, 4).

    ``face_colors`` (0 to 1) is None when the file has no colours, and grey for a part that has
    none among others that do. Corners at the same place are
    one vertex, faces without area are dropped, and node transforms that mirror keep their normals
    outward.
    """

    vertices: FloatArray
    faces: NDArray[np.int64]
    face_colors: FloatArray | None


def read_mesh_file(path: Path) -> FileMesh:
    """Read a mesh file; raise `RobotMeshError` for one that is of no known format or broken."""
    kind = path.suffix.lower()
    if kind not in FORMATS:
        raise RobotMeshError(f"mesh {path} is of no known format: {', '.join(FORMATS)} wanted")
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise RobotMeshError(f"mesh {path} has more than {MAX_FILE_BYTES} bytes")
        keywords, unit = _read_dae(path) if kind == ".dae" else (_read_raw(path), 1.0)
        parts = _parts(trimesh.load_scene(_unprocessed(keywords)), path)
    except RobotMeshError:
        raise
    except Exception as problem:  # trimesh's readers raise whatever their formats trip over
        reason = " ".join(str(problem).split()) or type(problem).__name__
        raise RobotMeshError(f"mesh {path} cannot be read: {reason}") from problem
    if not parts:
        raise RobotMeshError(f"mesh {path} holds no triangles")
    vertices = unit * np.concatenate([part[0] for part in parts])
    offsets = np.cumsum([0, *(len(part[0]) for part in parts)])
    faces = np.concatenate(
        [part[1] + offset for part, offset in zip(parts, offsets[:-1], strict=True)]
    )
    if not np.isfinite(vertices).all():
        raise RobotMeshError(f"mesh {path} has vertices that are not finite numbers")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise RobotMeshError(f"mesh {path} has faces of vertices that it does not hold")
    vertices, faces, kept = weld_vertices(vertices, faces)
    if len(faces) == 0:
        raise RobotMeshError(f"mesh {path} holds no triangles with an area")
    return FileMesh(vertices, faces, _joined_colors(parts, kept))


def _read_dae(path: Path) -> tuple[dict[str, Any], float]:
    from app.robot.meshes.collada import read_collada  # slow to load

    return read_collada(path)


def _read_raw(path: Path) -> dict[str, Any]:
    """Trimesh's keywords of a file; only files beside it (materials, buffers) are looked at."""
    kind = path.suffix.lower().removeprefix(".")
    load: Any = mesh_loaders[kind]
    # A PLY has its colours itself, and a picture of it would be opened for nothing.
    options = {"skip_materials": True} if kind == "ply" else {}
    with path.open("rb") as file:
        keywords: dict[str, Any] = load(
            file, file_type=kind, resolver=FilePathResolver(str(path)), **options
        )
    return keywords


def _unprocessed(keywords: dict[str, Any]) -> dict[str, Any]:
    """Keep trimesh from dropping vertices that are not finite: they have to be seen."""
    geometries = keywords.get("geometry", {"": keywords})
    for geometry in geometries.values():
        geometry["process"] = False
    return keywords


_Part = tuple[FloatArray, NDArray[np.int64], FloatArray | None]


def _parts(scene: Any, path: Path) -> list[_Part]:
    """Every geometry of the scene at every place it has, in the scene's frame."""
    parts: list[_Part] = []
    count = 0
    for node in sorted(scene.graph.nodes_geometry):
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            continue
        count += len(geometry.faces)
        if count > MAX_TRIANGLES:
            raise RobotMeshError(f"mesh {path} has more than {MAX_TRIANGLES} triangles")
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        faces = np.asarray(geometry.faces, dtype=np.int64)
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        if np.linalg.det(matrix[:3, :3]) < 0.0:
            faces = faces[:, ::-1]
        parts.append((vertices, faces, _face_colors(geometry)))
    return parts


def _face_colors(geometry: Any) -> FloatArray | None:
    visual, count = geometry.visual, len(geometry.faces)
    if not visual.defined:
        return None
    if visual.kind == "texture":
        color = np.asarray(visual.material.main_color, dtype=np.float64) / 255.0
        return np.tile(color, (count, 1))
    return np.asarray(visual.face_colors, dtype=np.float64).reshape(count, -1) / 255.0


def _joined_colors(parts: list[_Part], kept: NDArray[np.bool_]) -> FloatArray | None:
    if all(colors is None for _, _, colors in parts):
        return None
    grey = np.array([0.7, 0.7, 0.7, 1.0])
    colors = [np.tile(grey, (len(faces), 1)) if c is None else c for _, faces, c in parts]
    joined = np.concatenate(colors)[kept]
    return np.asarray(joined, dtype=np.float64)
