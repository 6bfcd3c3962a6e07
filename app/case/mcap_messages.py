"""The messages of an MCAP file in the file's order, from a file that may be cut or damaged.

The file is framed here, record by record, so that no length in it is trusted: what is whole is
yielded, and what is not is told to ``note``. The records are the mcap package's.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema
from mcap.stream_reader import breakup_chunk

from app.geometry import InputError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD_BYTES = 256 * 1024 * 1024
"""No record and no unpacked chunk may be larger."""

_HEAD = struct.Struct("<BQ")
# What the decoders raise on bytes that are not what they should be.
_DAMAGED = (
    McapError,
    struct.error,
    ValueError,
    OverflowError,
    RuntimeError,
    zstandard.ZstdError,
)


@dataclass(frozen=True, slots=True)
class Connection:
    """A topic of a recording; ``definition`` is the text of its message type's schema."""

    topic: str
    message_type: str
    definition: str
    definition_encoding: str


@dataclass(frozen=True, slots=True)
class RawMessage:
    """A message as it lies in the recording, in CDR."""

    connection: Connection
    data: bytes


def read_mcap_messages(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of ``path``; raises `InputError` when it is no MCAP file at all."""
    try:
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError(f"{path} is no MCAP file: it does not begin with the MCAP magic")
            yield from _messages(file, path.name, note)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error


def _messages(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[RawMessage]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Connection] = {}
    for record in _records(file, name, note):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            schema = schemas.get(record.schema_id)
            if schema is not None and record.message_encoding == "cdr":
                definition = schema.data.decode("utf-8", errors="replace")
                channels[record.id] = Connection(
                    record.topic, schema.name, definition, schema.encoding
                )
        elif isinstance(record, Message) and record.channel_id in channels:
            yield RawMessage(channels[record.channel_id], record.data)


def _records(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[McapRecord]:
    """Schemas, channels and messages, in chunks or not, up to the end of the data."""
    while True:
        offset = file.tell()
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        body = file.read(min(length, MAX_RECORD_BYTES))
        if len(head) < _HEAD.size or len(body) < length:
            note(f"{name} is cut or damaged at byte {offset}: what comes before is used")
            return
        try:
            found = _parsed(opcode, body)
        except _DAMAGED as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            note(f"{name}: the record at byte {offset} is damaged and skipped ({reason})")
            continue
        yield from found


def _parsed(opcode: int, body: bytes) -> list[McapRecord]:
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        return [Schema.read(stream)]
    if opcode == Opcode.CHANNEL:
        return [Channel.read(stream)]
    if opcode == Opcode.MESSAGE:
        return [Message.read(stream, len(body))]
    if opcode == Opcode.CHUNK:
        return breakup_chunk(_unpacked(Chunk.read(stream)), validate_crc=True)
    return []


def _unpacked(chunk: Chunk) -> Chunk:
    """The chunk without compression; its size is checked before anything is unpacked."""
    size = chunk.uncompressed_size
    if size > MAX_RECORD_BYTES:
        raise ValueError(f"a chunk of {size} bytes, at most {MAX_RECORD_BYTES} allowed")
    if chunk.compression == "zstd":
        # The reader stops at the size that was promised, whatever the stream would unfold to.
        with zstandard.ZstdDecompressor().stream_reader(BytesIO(chunk.data)) as packed:
            data = packed.read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    elif chunk.compression == "":
        data = chunk.data
    else:
        raise ValueError(f"compression {chunk.compression!r}, zstd, lz4 or none allowed")
    if len(data) != size:
        raise ValueError(f"a chunk unpacks to {len(data)} bytes or more, {size} promised")
    return replace(chunk, compression="", data=data)
