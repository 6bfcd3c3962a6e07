"""The messages of an MCAP file in the file's order, from a file that may be cut or damaged.

The file is framed here, record by record, so that no length in it is trusted: what is whole is
yielded, and what is not is told to ``note``. The records are the mcap package's, but for messages:
there are hundreds in a second of recording, and all that is wanted of them is their bytes.
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
"""No record and no unpacked chunk may be larger."""

_HEAD = struct.Struct("<BQ")
# Of a message: its channel, sequence, log time and publish time; its data follow.
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_MESSAGE = int(Opcode.MESSAGE)
# What the decoders raise on bytes that are not what they should be.
_DAMAGED = (
    McapError,
    struct.error,
    ValueError,
    OverflowError,
    RuntimeError,
    zstandard.ZstdError,
)


@dataclass(frozen=True, slots=True, eq=False)
class Connection:
    """A topic of a recording; ``definition`` is the text of its message type's schema.

    Compared by identity: it is looked up for every message.
    """

    topic: str
    message_type: str
    definition: str
    definition_encoding: str


RawMessage = tuple[Connection, bytes]
"""A message as it lies in the recording, in CDR."""

_Message = tuple[int, bytes]
"""Channel and data: plain, as there are so many."""

_Record = Schema | Channel | _Message


def read_mcap_messages(path: Path, note: Callable[[str], None]) -> Iterator[RawMessage]:
    """Yield the messages of ``path``; raises `InputError` when it is no MCAP file at all."""
    with open_for_reading(path) as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(f"{path} is no MCAP file: it does not begin with the MCAP magic")
        yield from _messages(file, path.name, note)


def _messages(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[RawMessage]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Connection] = {}
    # A recording may say its channels again and again: what knows a connection knows it then.
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
                said = (record.topic, schema.name, definition, schema.encoding)
                channels[record.id] = known.setdefault(said, Connection(*said))


def _records(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[_Record]:
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
    """The message that lies there, as far as the data go."""
    if length < _MESSAGE_HEAD.size:
        raise ValueError(f"a message of {length} bytes, its head alone has {_MESSAGE_HEAD.size}")
    channel_id, _, _, _ = _MESSAGE_HEAD.unpack_from(data, at)
    return channel_id, data[at + _MESSAGE_HEAD.size : at + length]


def _records_in(data: bytes) -> list[_Record]:
    """What an unpacked chunk holds; a last record that is cut is given as far as it goes."""
    records: list[_Record] = []
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if opcode == _MESSAGE:  # nearly all are
            records.append(_message(data, at, length))
        elif opcode != Opcode.CHUNK:  # none lies in another
            records += _parsed(opcode, data[at : at + length])
        at += length
    return records


def _unpacked(chunk: Chunk) -> bytes:
    """The chunk's records; its size is checked before anything is unpacked, its CRC after."""
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
    promised = chunk.uncompressed_crc  # 0: the writer computed none
    if promised and zlib.crc32(data) != promised:
        raise ValueError(f"crc of the chunk is {zlib.crc32(data):#010x}, {promised:#010x} promised")
    return data
