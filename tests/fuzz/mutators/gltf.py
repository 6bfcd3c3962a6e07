"""Mutations of glTF: its JSON, its node graph, and the chunks of a GLB."""

import json
import struct
from random import Random

from tests.fuzz.mutators.raw import Mutator
from tests.fuzz.mutators.text import TEXT
from tests.fuzz.mutators.tree import mutate_json

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_KEYS = (
    *("count", "byteOffset", "byteLength", "byteStride", "componentType", "bufferView", "buffer"),
    *("type", "sparse", "max"),
)
_VALUES = (
    *(0, 1, -1, 3, 7, 5120, 5121, 5123, 5125, 5126, 10**6, 10**9, 2**31, 2**63, 10**30, 1.5),
    *("VEC3", "MAT4", "SCALAR", None, {"count": 10**9}, []),
)


def change_graph(data: bytes, random: Random) -> bytes:
    """Make chains, loops, or nodes of several parents in the node graph."""
    document = json.loads(data)
    nodes = document["nodes"]
    first, parent = len(nodes), random.choice(nodes)
    match random.randrange(4):
        case 0:
            nodes += [{"children": [first + n + 1]} for n in range(random.choice((10, 100, 5000)))]
        case 1:
            first = random.randrange(len(nodes))
        case 2:
            nodes += [{"children": [first + n + 1] * 2} for n in range(random.choice((5, 20, 40)))]
        case _:
            nodes += [{"mesh": 0}] * random.choice((10, 1000))
            document["scenes"][0]["nodes"] += list(range(len(nodes)))
    nodes.append({"mesh": 0})
    parent.setdefault("children", []).append(first)
    return json.dumps(document).encode()


def change_accessor(data: bytes, random: Random) -> bytes:
    """Set a number of an accessor, a view or a buffer to an edge value."""
    document = json.loads(data)
    entry = random.choice(
        document[random.choice(("accessors", "accessors", "bufferViews", "buffers"))]
    )
    key = random.choice(_KEYS)
    entry[key] = random.choice(_VALUES)
    if random.random() < 0.2:
        del entry[key]
    return json.dumps(document).encode()


def _in_chunk(change: Mutator) -> Mutator:
    """Apply ``change``, a mutation of JSON, to the JSON chunk of a GLB."""

    def changed(data: bytes, random: Random) -> bytes:
        size = int.from_bytes(data[12:16], "little")
        text = change(data[20 : 20 + size], random)
        text += b" " * (-len(text) % 4)
        rest = data[20 + size :]
        head = struct.pack("<5I", _MAGIC, 2, 20 + len(text) + len(rest), len(text), _JSON)
        return head + text + rest

    return changed


def change_chunks(data: bytes, random: Random) -> bytes:
    """Change the header of the file or of a chunk, or add a chunk."""
    if random.random() < 0.3:
        return data + struct.pack("<2I", random.choice((0, 4, 2**31, 2**32 - 1)), _BIN) + b"abcd"
    size = int.from_bytes(data[12:16], "little")
    at = random.choice((0, 4, 8, 12, 16, 20 + size, 24 + size))
    value = random.choice((0, 1, 2, 3, 2**31, 2**32 - 1, len(data) + 4, _BIN, _JSON))
    return data[:at] + struct.pack("<I", value) + data[at + 4 :]


GLTF = (*TEXT, *[mutate_json] * 10, *[change_graph] * 3, *[change_accessor] * 8)

GLB = (
    *[_in_chunk(mutate_json)] * 5,
    *[_in_chunk(change_graph)] * 2,
    *[_in_chunk(change_accessor)] * 5,
    *[change_chunks] * 3,
)
"""For ``.glb``, beside the mutations of bytes."""
