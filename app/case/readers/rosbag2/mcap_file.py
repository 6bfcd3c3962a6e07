"""The messages of an MCAP file in the file's order, from a file that may be cut or damaged.

The file is split into records here, so that no length in it is trusted: intact records are used,
others are reported to ``note``. The mcap package decodes all records but messages: a second of
recording holds hundreds of them, and only their bytes are used.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from app.files.bounded_io import open_for_reading
from app.geometry import InputError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 256 * 1024 * 1024
"""Maximum size of a record and of an unpacked chunk."""

_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time of a message; its data follow."""
_MESSAGE = int(Opcode.MESSAGE)
_DAMAGED = (
    McapError,
    struct.error,
    ValueError,
    OverflowError,
    RuntimeError,
    zstandard.ZstdError,
)
"""What the decoders raise for damaged bytes."""


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """A topic of a recording; ``definition`` is the text of its message type's schema.

    Compared by identity, which is fast: there is a look-up per message.
    """

    topic: str
    message_type: str
    definition: str
    definition_encoding: str


RawMessage = tuple[Connection, bytes]
"""A message of the recording, in CDR."""

_Message = tuple[int, bytes]
"""Channel and data; a plain tuple because there are many."""

_Record = Schema | Channel | _Message


def read_mcap_messages(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of ``path``; `InputError` for a file that is not MCAP."""
    with open_for_reading(path) as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path} is not an MCAP file: it does not begin with the MCAP magic")
        yield from _messages(file, path.name, note)


def _messages(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[RawMessage]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Connection] = {}
    # A recording may repeat its channels: the same channel gives the same connection.
    known: dict[tuple[str, str, str, str], Connection] = {}
    for record in _records(file, name, note):
        if isinstance(record, tuple):
            channel_id, data = record
            channel = channels.get(channel_id)
            if channel is not None:
                yield channel, data
        elif isinstance(record, Schema):
            schemas[record.id] = record
        else:
            schema = schemas.get(record.schema_id)
            if schema is not None and record.message_encoding == "cdr":
                definition = schema.data.decode("utf-8", errors="replace")
                key = (record.topic, schema.name, definition, schema.encoding)
                channels[record.id] = known.setdefault(key, Connection(*key))


def _records(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[_Record]:
    """Yield schemas, channels and messages, in chunks or not, up to the end of the data."""
    while True:
        offset = file.tell()
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        body = file.read(min(length, MAX_RECORD_BYTES))
        if len(head) < _HEAD.size or len(body) < length:
            note(f"{name} is cut or damaged at byte {offset}; only what comes before is used")
            return
        try:
            found = _parsed(opcode, body)
        except _DAMAGED as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            note(f"{name}: the record at byte {offset} is damaged and skipped ({reason})")
            continue
        yield from found


def _parsed(opcode: int, body: bytes) -> list[_Record]:
    if opcode == Opcode.CHUNK:
        return _records_in(_unpacked(Chunk.read(ReadDataStream(BytesIO(body)))))
    if opcode == _MESSAGE:
        return [_message(body, 0, len(body))]
    if opcode == Opcode.SCHEMA:
        return [Schema.read(ReadDataStream(BytesIO(body)))]
    if opcode == Opcode.CHANNEL:
        return [Channel.read(ReadDataStream(BytesIO(body)))]
    return []


def _message(data: bytes, at: int, length: int) -> _Message:
    """The message at ``at``, as far as the data go."""
    if length < _MESSAGE_HEAD.size:
        raise ValueError(f"a message has {length} bytes; expected {_MESSAGE_HEAD.size} or more")
    channel_id, _, _, _ = _MESSAGE_HEAD.unpack_from(data, at)
    return channel_id, data[at + _MESSAGE_HEAD.size : at + length]


def _records_in(data: bytes) -> list[_Record]:
    """The records of an unpacked chunk; a last record that is cut is returned as far as it goes."""
    records: list[_Record] = []
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if opcode == _MESSAGE:  # most records
            records.append(_message(data, at, length))
        elif opcode != Opcode.CHUNK:  # chunks are not nested
            records += _parsed(opcode, data[at : at + length])
        at += length
    return records


def _unpacked(chunk: Chunk) -> bytes:
    """The unpacked records of a chunk. Its size is checked before unpacking, its CRC after."""
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk has {size} bytes; expected {MAX_RECORD_BYTES} or less")
    if chunk.compression == "zstd":
        # Reading stops at the declared size, however long the unpacked stream would be.
        with zstandard.ZstdDecompressor().stream_reader(BytesIO(chunk.data)) as packed:
            data = packed.read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression is {chunk.compression!r}; expected zstd, lz4 or none")
    if len(data) != size:
        raise ValueError(f"a chunk unpacks to {len(data)} bytes or more; expected {size}")
    expected = chunk.uncompressed_crc  # 0: the writer computed none
    if expected and zlib.crc32(data) != expected:
        raise ValueError(f"crc of the chunk is {zlib.crc32(data):#010x}; expected {expected:#010x}")
    return data
