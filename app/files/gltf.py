"""Guard of glTF 2.0 (``.gltf``, GLB), which trimesh reads: nodes, triangles and plain colours.

trimesh follows a node graph of any depth, reads sparse and compressed accessors as zeros, leaves
out fans and what is below a camera, takes a negative index from the end of a list, and allocates
what a file declares. So the schema of glTF checks the document first, then the rules here that it
cannot state. trimesh gets a document without pictures, cameras and extensions, and opens no file.
"""

import base64
import json
import math
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from jsonschema import ValidationError
from trimesh.exchange.gltf import load_gltf, validate

from app.files.linked_files import read_linked
from app.files.mesh_checks import MeshOptions
from app.geometry import InputError

MAX_JSON_BYTES = 32 * 1024 * 1024
MAX_VALUES = 50_000
"""Limit for the values of the document: the schema takes up to 0.1 ms for one."""

MAX_DEPTH = 100
"""Limit for the depth of the node tree."""

_UNUSED = {
    *("name", "extras", "extensions", "extensionsUsed", "animations", "targets", "weights"),
    *("camera", "cameras", "skin", "skins", "images", "textures", "samplers"),
}
_COMPRESSION = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "MPEG_accessor_timed"}
_TRIANGLES, _STRIP, _UINT16 = 4, 5, 5123
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_WHITE = [1.0, 1.0, 1.0, 1.0]
_GLB = b"glTF\2\0\0\0"


def read_gltf(content: bytes, path: Path, options: MeshOptions) -> dict[str, Any]:
    """Read the file's scene as keywords of `trimesh.load_scene`.

    Raises ``options.error`` for malformed files, for sparse or compressed geometry, for fans, for
    nodes that are not a tree of at most `MAX_DEPTH` levels, and for more bytes or, over all places,
    more triangles and vertices than allowed.
    """
    guard = _Guard(path, options)
    text, binary = content, b""
    if path.suffix.lower() == ".glb":
        text, binary = guard.chunks(content)
    document = guard.document(text)
    buffers = guard.buffers(binary)
    guard.check_accessors(buffers)
    guard.check_scene()
    load: Any = load_gltf  # has no types
    text = json.dumps(document).encode()
    keywords: dict[str, Any] = load(BytesIO(text), resolver=buffers)
    return keywords


class _Guard:
    def __init__(self, path: Path, options: MeshOptions) -> None:
        self._path = path
        self._options = options
        self._root: dict[str, Any] = {}
        self._values = self._triangles = self._vertices = 0

    def chunks(self, content: bytes) -> tuple[bytes, bytes]:
        """The JSON of a GLB, and its binary chunk, which is the second one; empty without it."""
        if not content.startswith(_GLB):
            self._refuse(f"begins with {content[:8]!r}; expected {_GLB!r}, which is version 2")
        chunks, at = [], 12
        for kind in (b"JSON", b"BIN\0"):
            size, start = int.from_bytes(content[at : at + 4], "little"), at + 8
            is_there = content[at + 4 : start] == kind
            if is_there and start + size > len(content):
                self._refuse(f"has a chunk of {size} bytes, and {len(content) - start} are left")
            at = start + size
            chunks.append(content[start:at] if is_there else b"")
        return chunks[0], chunks[1]

    def document(self, text: bytes) -> dict[str, Any]:
        """The document without its unused parts, of the form that the schema states."""
        if len(text) > MAX_JSON_BYTES:
            self._refuse(f"has {len(text)} bytes of JSON; expected at most {MAX_JSON_BYTES}")
        try:
            root: dict[str, Any] = self._used(json.loads(text))
        except (ValueError, RecursionError) as problem:  # ValueError: also malformed UTF-8
            self._refuse(f"is not JSON: {problem}")
        _clip_rotations(root)
        check: Any = validate  # has no types
        try:
            check(root)
        except ValidationError as problem:
            place, reason = problem.json_path[:80], problem.message[:160]
            self._refuse(f"is not glTF 2.0 at {place!r}: {reason}")
        version, required = root["asset"]["version"], root.pop("extensionsRequired", ())
        if not version.startswith("2."):
            self._refuse(f"is glTF {version[:40]!r}; expected version 2")
        for name in _COMPRESSION.intersection(required):
            self._refuse(f"requires the extension {name}; expected plain geometry")
        self._root = root
        return root

    def buffers(self, binary: bytes) -> dict[str, bytes]:
        """The bytes of the buffers by their new URI: of the GLB, a data URI or a linked file."""
        found: dict[str, bytes] = {}
        left = self._options.max_bytes
        for index, buffer in enumerate(self._root.get("buffers", ())):
            uri, what = buffer.get("uri"), f"has a buffer {index}"
            head, comma, data = (uri or "").partition(";base64,")
            try:
                if uri is None and index == 0 and binary:
                    content = binary
                elif comma and head.startswith("data:"):
                    content = base64.b64decode(data, validate=True)
                elif uri is None or uri.startswith("data:"):
                    self._refuse(f"{what} without data or of other text than base64")
                elif self._options.linked_files:
                    content = read_linked(self._path, unquote(uri), left)
                else:
                    self._refuse(f"{what} in the file {uri[:60]!r}; expected one file")
            except (ValueError, InputError) as problem:
                self._refuse(f"{what} that cannot be read: {problem}")
            left -= len(content)
            if left < 0:
                self._refuse(f"has buffers of more than {self._options.max_bytes} bytes")
            buffer["uri"] = str(index)
            found[str(index)] = content
        return found

    def check_accessors(self, buffers: dict[str, bytes]) -> None:
        """Refuse accessors outside of their buffers, and more bytes than allowed in all."""
        views, total = self._root.get("bufferViews", []), 0
        for number, view in enumerate(views):
            self._entry("buffers", view["buffer"])
            total += view["byteLength"]
            if view.get("byteOffset", 0) + view["byteLength"] > len(buffers[str(view["buffer"])]):
                self._refuse(f"has bufferViews[{number}] outside of its buffer")
        for number, accessor in enumerate(self._root.get("accessors", ())):
            count, kind = accessor["count"], (accessor["componentType"], accessor["type"])
            if kind[0] not in _BYTES or kind[1] not in _WIDTHS:
                self._refuse(f"has accessors[{number}] of {str(kind)[:60]}; expected those of glTF")
            row = _BYTES[kind[0]] * _WIDTHS[kind[1]]
            total += count * row
            if "bufferView" in accessor:
                view = self._entry("bufferViews", accessor["bufferView"])
                start, stride = accessor.get("byteOffset", 0), view.get("byteStride", row)
                if start + (count - 1) * stride + row > view["byteLength"]:
                    self._refuse(f"has {count} values in accessors[{number}] outside of its buffer")
        if total > 4 * self._options.max_bytes:
            self._refuse(f"declares {total} bytes; expected {4 * self._options.max_bytes}")

    def check_scene(self) -> None:
        """Refuse what is not a tree of triangles; give each part a node of its own.

        trimesh gives the parts of one node names that differ in each run.
        """
        nodes = self._root.get("nodes", [])
        places: dict[int, range] = {}
        parts: list[dict[str, Any]] = []
        for node in self._tree():
            mesh = node.pop("mesh", None)
            if mesh is not None and mesh not in places:
                first = len(parts)
                parts += self._parts(mesh)
                places[mesh] = range(first, len(parts))
            for part in places.get(mesh, ()):
                self._count(parts[part])
                node.setdefault("children", []).append(len(nodes))
                nodes.append({"mesh": part})
        self._root["meshes"] = [{"primitives": [part]} for part in parts]

    def _tree(self) -> list[dict[str, Any]]:
        """The nodes of the scene."""
        found: dict[int, dict[str, Any]] = {}
        scene = self._entry("scenes", self._root.get("scene", 0)) if "scenes" in self._root else {}
        waiting = [(index, 1) for index in scene.get("nodes", ())]
        while waiting:
            index, depth = waiting.pop()
            if index in found:
                self._refuse(f"reaches its node {index} twice; expected a tree")
            if depth > MAX_DEPTH:
                self._refuse(f"has nodes nested deeper than {MAX_DEPTH} levels")
            node = found[index] = self._entry("nodes", index)
            length = math.hypot(*node.get("rotation", (1.0,)))
            if not 0.5 < length < 2.0:
                self._refuse(f"has a rotation of length {length:g} in nodes[{index}]; expected 1")
            waiting += [(child, depth + 1) for child in node.get("children", ())]
        return list(found.values())

    def _parts(self, mesh: int) -> Iterator[dict[str, Any]]:
        """The primitives of triangles, with positions and one kind of colour."""
        for number, primitive in enumerate(self._entry("meshes", mesh)["primitives"]):
            place, mode = f"meshes[{mesh}].primitives[{number}]", primitive.get("mode", _TRIANGLES)
            if mode < _TRIANGLES:
                continue  # points and lines
            if mode > _STRIP:
                self._refuse(f"has the mode {mode} in {place}; expected a list or a strip")
            given = primitive["attributes"]
            self._check_values(given.get("POSITION"), ("VEC3",), f"positions of {place}")
            used = {"POSITION": given["POSITION"]}
            if "indices" in primitive:
                self._check_values(primitive["indices"], ("SCALAR",), f"indices of {place}")
            if "material" in primitive:
                material = self._entry("materials", primitive["material"])
                color = material.get("pbrMetallicRoughness", {}).get("baseColorFactor", _WHITE)
                material.clear()
                material["pbrMetallicRoughness"] = {"baseColorFactor": color}
            elif "COLOR_0" in given:
                self._check_values(given["COLOR_0"], ("VEC3", "VEC4"), f"colours of {place}")
                accessor = self._entry("accessors", given["COLOR_0"])
                if accessor["componentType"] != _UINT16:  # trimesh takes the low bytes
                    used["COLOR_0"] = given["COLOR_0"]
            yield {**primitive, "attributes": used}

    def _check_values(self, index: int | None, kinds: tuple[str, ...], what: str) -> None:
        accessor = {} if index is None else self._entry("accessors", index)
        if accessor.get("type") not in kinds:
            self._refuse(f"has {what} of {accessor.get('type')}; expected {' or '.join(kinds)}")
        if "sparse" in accessor or "bufferView" not in accessor:
            self._refuse(f"has {what} that are sparse or without data; expected plain geometry")
        if accessor.get("normalized") and kinds == ("VEC3",):
            self._refuse(f"has {what} that are normalized; expected metres")

    def _count(self, primitive: dict[str, Any]) -> None:
        """Add the triangles and vertices of a part at one of its places."""
        limit, accessors = self._options.max_triangles, self._root["accessors"]
        vertices = accessors[primitive["attributes"]["POSITION"]]["count"]
        corners = accessors[primitive["indices"]]["count"] if "indices" in primitive else vertices
        self._triangles += corners if primitive.get("mode") == _STRIP else corners // 3
        self._vertices += vertices
        if self._triangles > limit:
            self._refuse(f"has more than {limit} triangles")
        if self._vertices > 3 * limit:
            self._refuse(f"has {self._vertices} vertices or more; expected at most {3 * limit}")

    def _used(self, value: Any) -> Any:
        """Copy ``value`` without unused keys and empty lists."""
        self._values += 1
        if self._values > MAX_VALUES:
            self._refuse(f"has more than {MAX_VALUES} values; expected fewer parts")
        if isinstance(value, list):
            return [self._used(each) for each in value]
        if isinstance(value, dict):
            given = {k: each for k, each in value.items() if k not in _UNUSED and each != []}
            return {key: self._used(each) for key, each in given.items()}
        return value

    def _entry(self, kind: str, index: int) -> dict[str, Any]:
        entries: list[dict[str, Any]] = self._root.get(kind, [])
        if index >= len(entries):
            self._refuse(f"names {kind}[{index}]; expected 0 to {len(entries) - 1}")
        return entries[index]

    def _refuse(self, problem: str) -> NoReturn:
        raise self._options.error(f"mesh {self._path} {problem}")


def _clip_rotations(root: Any) -> None:
    """Cut the rotations of nodes to the schema's range: single precision rounds 1 to 1.0000001."""
    nodes = root.get("nodes") if isinstance(root, dict) else None
    for node in nodes if isinstance(nodes, list) else ():
        rotation = node.get("rotation") if isinstance(node, dict) else None
        if isinstance(rotation, list):
            node["rotation"] = [_clipped(value) for value in rotation]


def _clipped(value: Any) -> Any:
    is_rounded = isinstance(value, float) and 1.0 < abs(value) < 1.0 + 1e-5
    return math.copysign(1.0, value) if is_rounded else value
