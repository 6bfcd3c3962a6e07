"""Mutations within the parts of a container: MCAP records, ZIP members, database rows, NRRD."""

import gzip
import sqlite3
import struct
import warnings
import zipfile
import zlib
from contextlib import closing
from functools import cache
from io import BytesIO
from random import Random

import zstandard

from tests.fuzz.mutators.raw import RAW
from tests.fuzz.mutators.text import TEXT
from tests.fuzz.mutators.tree import mutate_xml

_HEAD = struct.Struct("<BQ")
_MAGIC_BYTES = 8
_CHUNK = 6
_BOMB_BYTES = 20_000_000


def _records(data: bytes, at: int) -> list[tuple[int, bytes]]:
    """Opcode and body of the MCAP records from ``at`` on, as far as they are intact."""
    found = []
    while at + _HEAD.size <= len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + length > len(data):
            break
        found.append((opcode, data[at : at + length]))
        at += length
    return found


def _joined(records: list[tuple[int, bytes]]) -> bytes:
    return b"".join(_HEAD.pack(opcode, len(body)) + body for opcode, body in records)


def _change(records: list[tuple[int, bytes]], random: Random) -> None:
    """Change, delete, repeat or move one record."""
    at = random.randrange(len(records))
    opcode, body = records[at]
    match random.randrange(6):
        case 0:
            del records[at]
        case 1:
            records[at:at] = [records[at]] * random.choice((1, 2, 100))
        case 2:
            records.insert(random.randrange(len(records)), records.pop(at))
        case 3:
            records[at] = (random.choice((0, 1, 3, 4, 5, 6, 9, 15, 128, 255)), body)
        case _:
            records[at] = (opcode, random.choice((*RAW, *TEXT))(body, random))


def change_mcap(data: bytes, random: Random) -> bytes:
    """Change a record of the file, or one within a chunk, whose sizes and sums stay right."""
    records = _records(data, _MAGIC_BYTES)
    chunks = [at for at, (opcode, body) in enumerate(records) if opcode == _CHUNK and body[40:]]
    if not chunks or random.random() < 0.2:
        _change(records, random)
        return data[:_MAGIC_BYTES] + _joined(records)
    at = random.choice(chunks)
    inner = _records(_chunk_content(records[at][1]), 0)
    for _ in range(random.choice((1, 1, 3))):
        _change(inner, random)
    records[at] = (_CHUNK, _chunk(_joined(inner), random))
    return data[:_MAGIC_BYTES] + _joined(records)


def _chunk_content(body: bytes) -> bytes:
    (size,) = struct.unpack_from("<Q", body, 16)
    if size > 1_000_000:
        raise ValueError("a bomb")
    (name_bytes,) = struct.unpack_from("<I", body, 28)
    packed = body[32 + name_bytes + 8 :]
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _chunk(content: bytes, random: Random) -> bytes:
    sizes = (len(content) + 1, 0, 2**64 - 1, 200_000_000)
    size = len(content) if random.random() < 0.9 else random.choice(sizes)
    packed = zstandard.compress(content)
    head = struct.pack("<QQQI", 0, 0, size, zlib.crc32(content))
    return head + struct.pack("<I4sQ", 4, b"zstd", len(packed)) + packed


def add_bomb(data: bytes, random: Random) -> bytes:
    """Insert chunks that unpack to far more than their size: zeros, or tiny records."""
    part = random.choice((b"\0", _joined([(5, bytes(22))]), _joined([(128, b"")])))
    record = _bomb(part, random.choice((1_000_000, _BOMB_BYTES)))
    records = _records(data, _MAGIC_BYTES)
    return data[:_MAGIC_BYTES] + record * random.choice((1, 10, 100)) + _joined(records[1:])


@cache
def _bomb(part: bytes, size: int) -> bytes:
    return _joined([(_CHUNK, _chunk(part * (size // len(part)), Random(0)))])


def change_member(data: bytes, random: Random) -> bytes:
    """Change the content, the name or the number of the members of a ZIP file."""
    with zipfile.ZipFile(BytesIO(data)) as bundle:
        members = [(name, bundle.read(name)) for name in bundle.namelist()]
    at = random.randrange(len(members))
    name, content = members[at]
    action, method = random.random(), random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))
    if action < 0.7:
        is_xml = name.endswith(".mrml") and action < 0.4
        members[at] = (name, (mutate_xml if is_xml else random.choice(TEXT))(content, random))
    elif action < 0.8:
        del members[at]
    elif action < 0.98:
        members.append((random.choice(("../x.mrml", "a/b.mrml", "x" * 300, name)), content))
    else:
        bomb = random.choice((b"\0", b"\n", b"<a/>", b"Seq_Frame0000_Timestamp = 1\n"))
        size = random.choice((100_000, _BOMB_BYTES))
        members[at] = (name, content + bomb * (size // len(bomb)))
        method = random.choice((zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    out = BytesIO()
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(out, "w", method) as bundle:
        for each, text in members:
            bundle.writestr(zipfile.ZipInfo(each), text, method)
    return out.getvalue()


_STATEMENTS = (
    "UPDATE messages SET data = zeroblob({n}) WHERE id = {i}",
    "UPDATE messages SET data = 'text' WHERE id = {i}",
    "UPDATE messages SET data = NULL, timestamp = {n}",
    "UPDATE messages SET timestamp = -{n}.5, topic_id = 'x' WHERE id = {i}",
    "UPDATE topics SET type = 'tf2_msgs/msg/TFMessage'",
    "UPDATE topics SET name = zeroblob({i})",
    "UPDATE topics SET serialization_format = NULL, offered_qos_profiles = zeroblob({i})",
    "UPDATE message_definitions SET encoded_message_definition = 'string[{n}] a'",
    "UPDATE message_definitions SET encoding = 'ros2idl'",
    "DELETE FROM topics",
    "DROP TABLE message_definitions",
    "INSERT INTO topics (name, type) SELECT name || '{i}', type FROM topics",
    "INSERT INTO messages (topic_id, timestamp, data) SELECT 1, {n}, data FROM messages",
    "ALTER TABLE messages ADD COLUMN more AS (zeroblob({n}))",
    "ALTER TABLE messages RENAME TO m",
    "CREATE VIEW messages AS WITH RECURSIVE r(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM r) "
    "SELECT id, 1 AS topic_id, id AS timestamp, zeroblob(9) AS data FROM r",
)


def change_rows(data: bytes, random: Random) -> bytes:
    """Change rows, tables or the schema of a rosbag2 database."""
    with closing(sqlite3.connect(":memory:")) as database:
        database.deserialize(data)
        for _ in range(random.choice((1, 2))):
            statement = random.choice(_STATEMENTS)
            number = random.choice((0, 1, 5000, 500_000, 2**31, 2**63 - 1))
            database.execute(statement.format(n=number, i=random.randrange(12)))
        database.commit()
        return database.serialize()


def change_nrrd_header(data: bytes, random: Random) -> bytes:
    head, end, rest = data.partition(b"\n\n")
    return random.choice(TEXT)(head, random) + end + rest


def change_nrrd_data(data: bytes, random: Random) -> bytes:
    """Replace the data by others of any length, or by noise of the right length."""
    head, end, rest = data.partition(b"\n\n")
    size = random.choice((0, 7, len(rest), 512, 4096, 100_000))
    content = random.randbytes(size) if random.random() < 0.5 else bytes([1, 0]) * (size // 2)
    if b"gzip" in head:
        content = _zeros() if random.random() < 0.1 else gzip.compress(content, 1)
    return head + end + content


@cache
def _zeros() -> bytes:
    return gzip.compress(bytes(_BOMB_BYTES), 1)


MCAP = (*[change_mcap] * 24, *RAW * 2, add_bomb)
ZIP = (*[change_member] * 12, *RAW)
DATABASE = (*[change_rows] * 8, *RAW)
NRRD = (*[change_nrrd_header] * 10, *[change_nrrd_data] * 4, *RAW)
