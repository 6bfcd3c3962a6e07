"""The JSON and the buffers of a glTF 2.0 file, from ``.gltf`` or GLB.

Checked access: every value that is read is of its type and within its range, so that a reader of
geometry can rely on it. See the glTF 2.0 specification (ISO/IEC 12113), chapters 3 and 4.
"""

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

from app.files.linked_files import read_linked
from app.files.mesh_options import MeshOptions
from app.geometry import InputError

MAX_JSON_BYTES = 32 * 1024 * 1024
MAX_ENTRIES = 100_000
"""Limit for the nodes, and for the accessors, of a file."""

_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_DATA_URI = "data:"


class GltfDocument:
    """The JSON of a file as ``root``, with checked access to its values."""

    def __init__(self, content: bytes, path: Path, options: MeshOptions) -> None:
        self.path = path
        self._options = options
        self._binary: bytes | None = None
        text = content
        if path.suffix.lower() == ".glb":
            text, self._binary = self._chunks(content)
        if len(text) > MAX_JSON_BYTES:
            self.refuse(f"has {len(text)} bytes of JSON; expected at most {MAX_JSON_BYTES}")
        try:
            root = json.loads(text)
        except (ValueError, RecursionError) as problem:  # ValueError: also malformed UTF-8
            self.refuse(f"is not JSON: {problem}")
        self.root: dict[str, Any] = self.mapping(root, "the document")
        version = self.mapping(self.root.get("asset", {}), "asset").get("version", "2.0")
        if not str(version).startswith("2."):
            self.refuse(f"is glTF {str(version)[:40]!r}; expected version 2")
        self._buffers: dict[int, bytes] = {}
        self._left_bytes = options.max_bytes

    def refuse(self, problem: str) -> NoReturn:
        """Raise the error of the caller's type."""
        raise self._options.error(f"mesh {self.path} {problem}")

    def mapping(self, value: Any, place: str) -> dict[str, Any]:
        """Return ``value``, which must be a mapping."""
        if not isinstance(value, dict):
            self.refuse(f"has {_shown(value)} as {place}; expected a mapping")
        return value

    def items(self, holder: dict[str, Any], key: str, place: str) -> list[Any]:
        """Return the list under ``key``, empty where it is missing."""
        value = holder.get(key, [])
        if not isinstance(value, list) or len(value) > MAX_ENTRIES:
            self.refuse(f"has {_shown(value)} as {place}; expected a list of at most {MAX_ENTRIES}")
        return value

    def entry(self, kind: str, index: Any, place: str) -> dict[str, Any]:
        """Return the mapping that ``index`` selects in the list ``kind`` of the document."""
        entries = self.items(self.root, kind, kind)
        if type(index) is not int or not 0 <= index < len(entries):
            self.refuse(f"has {_shown(index)} as {place}; expected 0 to {len(entries) - 1}")
        return self.mapping(entries[index], f"{kind}[{index}]")

    def integer(
        self, holder: dict[str, Any], key: str, place: str, default: int | None = None
    ) -> int:
        """Return the integer of at least 0 under ``key``."""
        value = holder.get(key, default)
        if type(value) is not int or not 0 <= value < 1 << 40:
            self.refuse(f"has {_shown(value)} as {place}.{key}; expected an integer of at least 0")
        return value

    def numbers(self, value: Any, count: int, place: str) -> list[float]:
        """Return ``value``, which must be a list of ``count`` numbers."""
        is_list = isinstance(value, list) and len(value) == count
        if not is_list or not all(type(each) in (int, float) for each in value):
            self.refuse(f"has {_shown(value)} as {place}; expected {count} numbers")
        try:
            return [float(each) for each in value]
        except OverflowError:
            self.refuse(f"has {_shown(value)} as {place}; expected numbers of double precision")

    def buffer(self, index: Any) -> bytes:
        """Return the bytes of a buffer: of the GLB, of a data URI, or of a linked file."""
        entry = self.entry("buffers", index, "a buffer")
        if index not in self._buffers:
            content = self._read_buffer(index, entry)
            self._left_bytes -= len(content)
            if self._left_bytes < 0:
                self.refuse(f"has buffers of more than {self._options.max_bytes} bytes")
            self._buffers[index] = content
        return self._buffers[index]

    def _read_buffer(self, index: int, entry: dict[str, Any]) -> bytes:
        uri = entry.get("uri")
        if uri is None:
            if index != 0 or self._binary is None:
                self.refuse(f"has a buffer {index} without data")
            return self._binary
        if not isinstance(uri, str):
            self.refuse(f"has {_shown(uri)} as the URI of buffer {index}; expected a text")
        if uri.startswith(_DATA_URI):
            head, comma, data = uri.partition(",")
            if not comma or not head.endswith(";base64"):
                self.refuse(f"has the data URI {head[:60]!r} in buffer {index}; expected base64")
            try:
                return base64.b64decode(data, validate=True)
            except (binascii.Error, ValueError) as problem:
                self.refuse(f"has a data URI in buffer {index} that is not base64: {problem}")
        if not self._options.linked_files:
            self.refuse(f"has its buffer {index} in the file {uri[:60]!r}; expected one file")
        try:
            return read_linked(self.path, unquote(uri), self._options.max_bytes)
        except InputError as problem:
            self.refuse(f"has a buffer {index} that cannot be read: {problem}")

    def _chunks(self, content: bytes) -> tuple[bytes, bytes | None]:
        """The JSON chunk of a GLB, and its first binary chunk."""
        if len(content) < _HEADER.size + _CHUNK.size:
            self.refuse("is not a GLB: it is shorter than its header")
        magic, version, _ = _HEADER.unpack_from(content)
        if magic != b"glTF" or version != 2:
            self.refuse(f"begins with {magic!r}, version {version}; expected b'glTF', version 2")
        chunks: list[tuple[bytes, bytes]] = []
        at = _HEADER.size
        while at + _CHUNK.size <= len(content) and len(chunks) < MAX_ENTRIES:
            size, kind = _CHUNK.unpack_from(content, at)
            at += _CHUNK.size
            if at + size > len(content):
                self.refuse(f"has a chunk of {size} bytes, and {len(content) - at} are left")
            chunks.append((kind, content[at : at + size]))
            at += size
        if chunks[0][0] != b"JSON":
            self.refuse(f"begins with a chunk {chunks[0][0]!r}; expected JSON")
        binary = next((data for kind, data in chunks[1:] if kind == b"BIN\0"), None)
        return chunks[0][1], binary


def _shown(value: Any) -> str:
    if isinstance(value, list | dict):
        return f"a {'list' if isinstance(value, list) else 'mapping'} of {len(value)}"
    return repr(value)[:60]
