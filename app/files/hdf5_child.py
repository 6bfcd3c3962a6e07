"""Process that reads ITK transforms from HDF5 files, with limits of time, memory and files.

The standard input has the limit of processor time in s (8 bytes), then each file with its length
(8 bytes). The standard output gets one line of JSON per file: its transforms, or an error.
"""

import json
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import h5py

from app.files.child_process import answer_request, limit_this_process

MAX_MEMORY_BYTES = 256 * 1024 * 1024
"""Limit for the memory that reading adds to that of the interpreter."""

_MAX_TRANSFORMS = 64
_MAX_NUMBERS = 64
_MAX_TYPE_CHARS = 100
# Older versions of ITK misspell the names.
_PARAMETERS = ("TransformParameters", "TranformParameters")
_FIXED = ("TransformFixedParameters", "TranformFixedParameters")


def answers(request: bytes) -> Iterator[bytes]:
    """Yield the line of each file of ``request``. Limits this process."""
    stream = BytesIO(request)
    (max_cpu_s,) = struct.unpack(">d", stream.read(8))
    limit_this_process(max_cpu_s, MAX_MEMORY_BYTES)
    while header := stream.read(8):
        (size,) = struct.unpack(">Q", header)
        yield _answer(stream.read(size)) + b"\n"


def _answer(content: bytes) -> bytes:
    try:
        with h5py.File(BytesIO(content), "r") as file:
            found: dict[str, Any] = _transforms(file)
    # h5py raises many types for damaged files.
    except Exception as problem:
        text = " ".join(str(problem).split())[:200]
        found = {"error": text if text.isprintable() else type(problem).__name__}
    return json.dumps(found).encode("ascii")


def _transforms(file: h5py.File) -> dict[str, Any]:
    group = _group(file, "TransformGroup")
    names = sorted(group.keys(), key=lambda name: (len(name), name))[: _MAX_TRANSFORMS + 1]
    if len(names) > _MAX_TRANSFORMS:
        raise ValueError(f"more than {_MAX_TRANSFORMS} transforms")
    kinds = [_text(_group(group, name)) for name in names]
    found: dict[str, Any] = {"kinds": kinds, "parameters": [], "fixed": []}
    if len(names) == 1:
        only = _group(group, names[0])
        found["parameters"], found["fixed"] = _numbers(only, _PARAMETERS), _numbers(only, _FIXED)
    return found


def _group(parent: h5py.Group, name: str) -> h5py.Group:
    found = _member(parent, name)
    if not isinstance(found, h5py.Group):
        raise ValueError(f"{name} is not a group")
    return found


def _member(parent: h5py.Group, name: str) -> Any:
    """A member that is in this file: links to others are not followed."""
    link = parent.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"it has no {name}")
    return parent[name]


def _dataset(parent: h5py.Group, name: str) -> h5py.Dataset:
    found = _member(parent, name)
    if not isinstance(found, h5py.Dataset) or found.external or found.is_virtual:
        raise ValueError(f"{name} is not stored in the file")
    if found.size is None or found.size > _MAX_NUMBERS:
        raise ValueError(f"{name} has {found.size} values; expected {_MAX_NUMBERS} or fewer")
    return found


def _text(group: h5py.Group) -> str:
    data = _dataset(group, "TransformType")
    if data.size != 1 or h5py.check_string_dtype(data.dtype) is None:
        raise ValueError("TransformType is not a text")
    value = data.asstr()[()]
    text = str(value if isinstance(value, str) else value.ravel()[0])
    if len(text) > _MAX_TYPE_CHARS or not text.isprintable():
        raise ValueError("TransformType is not a name")
    return text


def _numbers(group: h5py.Group, names: tuple[str, ...]) -> list[float]:
    name = next((each for each in names if each in group), names[0])
    data = _dataset(group, name)
    if data.dtype.kind != "f":
        raise ValueError(f"{name} is {data.dtype}; expected floating point numbers")
    return [float(value) for value in data[()].ravel()]


if __name__ == "__main__":
    answer_request(lambda request: answers(request.read()))
