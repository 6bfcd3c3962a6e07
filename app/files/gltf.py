"""Triangles of glTF 2.0 files (``.gltf``, GLB): each mesh at each of its places, with its colour.

trimesh reads glTF too, but follows a node graph of any depth and count, reads sparse and compressed
accessors as zeros, and allocates what an accessor declares. Here the graph is one tree of bounded
depth (as the specification requires), and every accessor lies in its buffer. Compressed geometry
and sparse accessors are refused.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from app.files.gltf_document import GltfDocument
from app.files.mesh_options import MeshOptions
from app.files.mesh_part import MeshPart, placed
from app.geometry import FloatArray

MAX_DEPTH = 100
"""Limit for the depth of the node tree."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_COMPRESSION = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "MPEG_accessor_timed")


def read_gltf(content: bytes, path: Path, options: MeshOptions) -> list[MeshPart]:
    """Return the triangles of the file's scene.

    Raises ``options.error`` for malformed files, for compressed geometry, for nodes that are not a
    tree of at most `MAX_DEPTH` levels, and for more than ``options.max_triangles``.
    """
    return _Reader(GltfDocument(content, path, options), options).parts()


class _Reader:
    def __init__(self, document: GltfDocument, options: MeshOptions) -> None:
        self._document = document
        self._max_triangles = options.max_triangles
        self._max_bytes = options.max_bytes
        self._triangles = 0
        self._meshes: dict[int, list[MeshPart]] = {}
        self._visited: set[int] = set()

    def parts(self) -> list[MeshPart]:
        document = self._document
        required = document.items(document.root, "extensionsRequired", "extensionsRequired")
        for name in _COMPRESSION:
            if name in required:
                document.refuse(f"requires the extension {name}; expected plain geometry")
        if not document.items(document.root, "scenes", "scenes"):
            return []
        scene = document.entry("scenes", document.root.get("scene", 0), "scene")
        parts: list[MeshPart] = []
        waiting = [
            (index, np.eye(4), 1) for index in document.items(scene, "nodes", "nodes of the scene")
        ]
        while waiting:
            index, parent, depth = waiting.pop()
            node = document.entry("nodes", index, "a node")
            if index in self._visited:
                document.refuse(f"reaches its node {index} twice; expected a tree")
            if depth > MAX_DEPTH:
                document.refuse(f"has nodes nested deeper than {MAX_DEPTH} levels")
            self._visited.add(index)
            matrix = parent @ self._matrix(node, f"nodes[{index}]")
            children = document.items(node, "children", f"nodes[{index}].children")
            waiting += [(child, matrix, depth + 1) for child in children]
            if "mesh" in node:
                for vertices, faces, colors in self._mesh(node["mesh"]):
                    self._count(len(faces))
                    parts.append(placed(vertices, faces, colors, matrix))
        return parts

    def _count(self, triangles: int) -> None:
        self._triangles += triangles
        if self._triangles > self._max_triangles:
            self._document.refuse(f"has more than {self._max_triangles} triangles")

    def _matrix(self, node: dict[str, Any], place: str) -> FloatArray:
        """``parent_from_node`` (4, 4)."""
        document = self._document
        matrix = np.eye(4)
        if "matrix" in node:
            numbers = document.numbers(node["matrix"], 16, f"{place}.matrix")
            matrix = np.array(numbers).reshape(4, 4).T
        if "translation" in node:
            moved = np.eye(4)
            moved[:3, 3] = document.numbers(node["translation"], 3, f"{place}.translation")
            matrix = matrix @ moved
        if "rotation" in node:
            rotation = np.array(document.numbers(node["rotation"], 4, f"{place}.rotation"))
            length = float(np.linalg.norm(rotation))
            if not 0.5 < length < 2.0:
                document.refuse(f"has a rotation of length {length:g} in {place}; expected 1")
            turned = np.eye(4)
            turned[:3, :3] = Rotation.from_quat(rotation).as_matrix()
            matrix = matrix @ turned
        if "scale" in node:
            scale = document.numbers(node["scale"], 3, f"{place}.scale")
            matrix = matrix @ np.diag([*scale, 1.0])
        return matrix

    def _mesh(self, index: Any) -> list[MeshPart]:
        mesh = self._document.entry("meshes", index, "a mesh")
        if index not in self._meshes:
            self._meshes[index] = list(self._read_mesh(mesh, f"meshes[{index}]"))
        return self._meshes[index]

    def _read_mesh(self, mesh: dict[str, Any], place: str) -> Iterator[MeshPart]:
        document = self._document
        for number, value in enumerate(document.items(mesh, "primitives", f"{place}.primitives")):
            where = f"{place}.primitives[{number}]"
            primitive = document.mapping(value, where)
            mode = document.integer(primitive, "mode", where, _TRIANGLES)
            if mode < _TRIANGLES:
                continue  # points and lines
            if mode not in (_TRIANGLES, _STRIP, _FAN):
                document.refuse(f"has the mode {mode} in {where}; expected 0 to 6")
            attributes = document.mapping(primitive.get("attributes"), f"{where}.attributes")
            vertices = self._accessor(attributes.get("POSITION"), 3, where).astype(np.float64)
            corners = np.arange(len(vertices))
            if "indices" in primitive:
                corners = self._accessor(primitive["indices"], 1, where)[:, 0].astype(np.int64)
            faces = self._faces(corners, mode, where)
            yield vertices, faces, self._colors(primitive, attributes, faces, len(vertices), where)

    def _faces(self, corners: NDArray[np.int64], mode: int, where: str) -> NDArray[np.int64]:
        """Triangles (n, 3) of the corners of a list, a strip or a fan."""
        if mode == _TRIANGLES:
            if len(corners) % 3:
                self._document.refuse(f"has {len(corners)} corners in {where}; expected triples")
            return corners.reshape(-1, 3)
        count = max(len(corners) - 2, 0)
        first = np.arange(count)
        if mode == _FAN:
            common = np.broadcast_to(corners[:1], count) if count else corners[:0]
            return np.stack([corners[first + 1], corners[first + 2], common], axis=1)
        # Every second triangle of a strip has its corners in the other order.
        odd = first % 2
        return np.stack(
            [corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=1
        )

    def _accessor(self, index: Any, width: int, where: str) -> NDArray[Any]:
        """Numbers (n, ``width``) of an accessor."""
        document = self._document
        accessor = document.entry("accessors", index, f"an accessor of {where}")
        place = f"accessors[{index}]"
        kind, component = accessor.get("type"), accessor.get("componentType")
        if _WIDTHS.get(str(kind)) != width or component not in list(_COMPONENTS):
            document.refuse(
                f"has {place} of {str(kind)[:40]!r}, {str(component)[:40]!r}; expected {width} "
                f"values of one of {', '.join(map(str, _COMPONENTS))}"
            )
        if "sparse" in accessor or "bufferView" not in accessor:
            document.refuse(f"has {place}, sparse or without data; expected plain geometry")
        view = document.entry("bufferViews", accessor["bufferView"], f"{place}.bufferView")
        if not set(_COMPRESSION).isdisjoint(document.mapping(view.get("extensions", {}), place)):
            document.refuse(f"has compressed data in {place}; expected plain geometry")
        data = document.buffer(view.get("buffer"))
        dtype = np.dtype(_COMPONENTS[component])
        row = dtype.itemsize * width
        count = document.integer(accessor, "count", place)
        stride = document.integer(view, "byteStride", f"{place}.bufferView", 0) or row
        length = document.integer(view, "byteLength", f"{place}.bufferView")
        inner = document.integer(accessor, "byteOffset", place, 0)
        start = inner + document.integer(view, "byteOffset", f"{place}.bufferView", 0)
        used = (count - 1) * stride + row if count else 0
        if stride < row or inner + used > length or start + used > len(data):
            document.refuse(f"has {count} values in {place} that are outside of its buffer")
        if count * row > self._max_bytes:
            document.refuse(f"has {count} values in {place}; expected {self._max_bytes} bytes")
        raw = np.frombuffer(data, np.uint8, used, start) if used else np.zeros(0, np.uint8)
        rows = np.lib.stride_tricks.as_strided(raw, (count, row), (stride, 1), writeable=False)
        return np.ascontiguousarray(rows).view(dtype).reshape(count, width)

    def _colors(
        self,
        primitive: dict[str, Any],
        attributes: dict[str, Any],
        faces: NDArray[np.int64],
        vertex_count: int,
        where: str,
    ) -> FloatArray | None:
        """Colours (n, 4) of the faces: of the material, or the mean of those of the corners."""
        document = self._document
        if "material" in primitive:
            material = document.entry("materials", primitive["material"], f"{where}.material")
            looks = document.mapping(material.get("pbrMetallicRoughness", {}), "a material")
            factor = looks.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
            color = np.clip(document.numbers(factor, 4, "baseColorFactor"), 0.0, 1.0)
            return np.tile(np.nan_to_num(color), (len(faces), 1))
        if "COLOR_0" not in attributes:
            return None
        accessor = document.entry("accessors", attributes["COLOR_0"], f"{where}.COLOR_0")
        width = 3 if accessor.get("type") == "VEC3" else 4
        values = self._accessor(attributes["COLOR_0"], width, where)
        if len(values) != vertex_count:
            document.refuse(f"has {len(values)} colours in {where}; expected {vertex_count}")
        top = 1.0 if values.dtype.kind == "f" else float(np.iinfo(values.dtype).max)
        rgba = np.ones((vertex_count, 4))
        rgba[:, :width] = np.clip(np.nan_to_num(values / top), 0.0, 1.0)
        if len(faces) and (faces.min() < 0 or faces.max() >= vertex_count):
            document.refuse(f"has faces of vertices that {where} does not hold")
        return np.asarray(rgba[faces].mean(axis=1))
