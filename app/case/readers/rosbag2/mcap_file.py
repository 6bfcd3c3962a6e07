"""The messages of an MCAP file in the file's order. It may be cut, damaged or hostile.

No length in the file is trusted: intact records are used, others are reported. The mcap package
decodes all records but messages: a second of recording holds hundreds of them, and only their bytes
are used. Messages that follow each other in a chunk are yielded together, so that they can be
decoded at once.

Limits: a record and an unpacked chunk have `MAX_MESSAGE_BYTES`; all chunks together unpack to
`_MAX_RATIO` times the bytes read, which real recordings do not approach (lz4 cannot exceed it), so
that the time to read a file is proportional to its size.
"""

import struct
import zlib
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

from app.case.readers.recording_format import (
    MAX_CONNECTIONS,
    MAX_DEFINITION_BYTES,
    MAX_MESSAGE_BYTES,
    MAX_RUN_BYTES,
    MAX_RUN_MESSAGES,
    Connection,
    MessagePlace,
    MessageRun,
    RunMessage,
)
from app.files.bounded_io import open_for_reading
from app.geometry import InputError

MAGIC = b"\x89MCAP0\r\n"

_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_BOTH_HEADS = struct.Struct("<BQHIQQ")
_FOOTER_HEAD = struct.Struct("<QQI")
_MESSAGE = int(Opcode.MESSAGE)
_READ = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)
_END_BYTES = 4
"""Content of a DataEnd record."""

_MAX_RATIO = 256
_FREE_BYTES = 16 * 1024 * 1024
"""May be unpacked in addition to `_MAX_RATIO`, for short files with a compressible picture."""

_DAMAGED = (McapError, struct.error, ValueError, OverflowError, RuntimeError, zstandard.ZstdError)
"""Errors of the decoders for damaged bytes."""


Record = Schema | Channel | list[RunMessage]
"""A list holds messages that follow each other, without another record between them."""


def read_records(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[Record]:
    """Yield schemas, channels and runs of messages, in chunks or not, up to the end of the data.

    ``file`` is at its start; ``name`` is for messages. Skipped records, a cut file and a missing
    index are reported to ``note``. Raises `InputError` for a file that is not MCAP, and for one
    that unpacks beyond the limit.
    """
    if file.read(len(MAGIC)) != MAGIC:
        raise InputError(f"{name} is not an MCAP file: it does not begin with the MCAP magic")
    yield from read_records_from(file, name, note)


def read_records_from(file: IO[bytes], name: str, note: Callable[[str], None]) -> Iterator[Record]:
    """Yield like `read_records`, from the present place of ``file`` on, where a record begins.

    After each yielded record ``file`` is at its end, or at the end of the chunk that it is in.
    """
    size = _size(file)
    unpacked = 0
    while True:
        offset = file.tell()
        head = file.read(_HEAD.size)
        opcode, length = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            if opcode == Opcode.DATA_END and not _has_index(file):
                note(
                    f"{name} has no index, as after a crash of its recorder: its last messages may "
                    "be missing; 'marginguard convert recover' adds an index"
                )
            return
        if len(head) < _HEAD.size or offset + _HEAD.size + length > size:
            note(f"{name} is cut or damaged at byte {offset}; only what comes before is used")
            return
        if opcode not in _READ or length > MAX_MESSAGE_BYTES:
            if opcode in _READ:
                note(
                    f"{name}: the record at byte {offset} has {length} bytes and is skipped; "
                    f"expected {MAX_MESSAGE_BYTES} or less"
                )
            file.seek(length, 1)
            continue
        try:
            body = file.read(length)
            if opcode == Opcode.CHUNK:
                body = _unpacked(Chunk.read(ReadDataStream(BytesIO(body))))
                unpacked += len(body)
                _check_ratio(unpacked, file.tell(), name)
                yield from _records_in(body)
            else:
                yield _parsed(opcode, body)
        except _DAMAGED as error:
            reason = (str(error) or type(error).__name__).splitlines()[0]
            note(f"{name}: the record at byte {offset} is damaged and skipped ({reason})")


def _size(file: IO[bytes]) -> int:
    at = file.tell()
    size = file.seek(0, 2)
    file.seek(at)
    return size


def _has_index(file: IO[bytes]) -> bool:
    """True unless a footer that states no index follows the DataEnd record that is next."""
    file.seek(_END_BYTES, 1)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size or head[0] != Opcode.FOOTER:
        return True  # the index comes first
    footer = file.read(_FOOTER_HEAD.size)
    return len(footer) == _FOOTER_HEAD.size and _FOOTER_HEAD.unpack(footer)[0] != 0


def _check_ratio(unpacked: int, packed: int, name: str) -> None:
    if unpacked > _FREE_BYTES + _MAX_RATIO * packed:
        raise InputError(
            f"{name}: its first {packed} bytes unpack to {unpacked}; "
            f"expected {_MAX_RATIO} times as many or less"
        )


def _parsed(opcode: int, body: bytes) -> Record:
    if opcode == _MESSAGE:
        return [_message(body, 0, len(body))]
    stream = ReadDataStream(BytesIO(body))
    found: Record = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
    return found


def _message(data: bytes, at: int, length: int) -> RunMessage:
    """The message at ``at``, as far as the data go."""
    if length < _MESSAGE_HEAD.size:
        raise ValueError(f"a message has {length} bytes; expected {_MESSAGE_HEAD.size} or more")
    channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(data, at)
    content = data[at + _MESSAGE_HEAD.size : at + length]
    return channel, content, log_ns, publish_ns, sequence


def _records_in(data: bytes) -> Iterator[Record]:
    """Yield the records of an unpacked chunk, a last one that is cut as far as it goes."""
    run: list[RunMessage] = []
    at = began = 0
    last_at = len(data) - _BOTH_HEADS.size
    unpack = _BOTH_HEADS.unpack_from
    try:
        while at < len(data):
            if at <= last_at:
                opcode, length, channel, sequence, log_ns, publish_ns = unpack(data, at)
                if opcode == _MESSAGE and length >= _MESSAGE_HEAD.size:  # most records
                    content_at = at + _BOTH_HEADS.size
                    at += _HEAD.size + length
                    run.append((channel, data[content_at:at], log_ns, publish_ns, sequence))
                    if len(run) >= MAX_RUN_MESSAGES or at - began > MAX_RUN_BYTES:
                        yield run
                        run, began = [], at
                    continue
            opcode, length = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if opcode == _MESSAGE:
                run.append(_message(data, at, length))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                if run:
                    yield run
                run, began = [], at
                yield _parsed(opcode, data[at : at + length])
            else:  # bytes without meaning; no other record may be in a chunk
                raise ValueError(
                    f"a chunk holds opcode {opcode}; expected schemas, channels, messages"
                )
            at += length
    except Exception:
        if run:  # what comes before the damage
            yield run
        raise
    if run:
        yield run


def _unpacked(chunk: Chunk) -> bytes:
    """The unpacked records of a chunk. Its size is checked before unpacking, its CRC after."""
    size = chunk.uncompressed_size
    if size > MAX_MESSAGE_BYTES:
        raise ValueError(f"a chunk has {size} bytes; expected {MAX_MESSAGE_BYTES} or less")
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


_MAX_SCHEMAS = 2048
_MAX_SCHEMA_BYTES = 64 * MAX_DEFINITION_BYTES
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


def read_mcap_runs(path: Path, note: Callable[[str], None]) -> Iterator[MessageRun]:
    """Yield the messages of ``path`` in runs, which do not reach across damage that is noted.

    Raises `InputError` for a file that is not MCAP or exceeds a limit. A definition above
    `MAX_DEFINITION_BYTES` is left out and reported to ``note``.
    """
    with open_for_reading(path) as file:
        channels = _Channels(path.name, note)
        for record in read_records(file, path.name, note):
            if isinstance(record, list):
                yield MessageRun(channels.connections, record)
            elif isinstance(record, Schema):
                channels.add_schema(record)
            else:
                channels.add_channel(record)


def read_placed_messages(path: Path, topic: str) -> Iterator[tuple[MessagePlace, bytes]]:
    """Yield the messages of ``topic``, each with the place for `read_placed_message`."""
    with open_for_reading(path) as file:
        channels = _Channels(path.name, _ignored)
        start = end = len(MAGIC)
        counts: dict[int, int] = {}
        for record in read_records(file, path.name, _ignored):
            if file.tell() != end:  # another record or chunk of the file
                start, end = end, file.tell()
                counts.clear()
            if isinstance(record, list):
                for number, data, *_ in record:
                    index = counts[number] = counts.get(number, -1) + 1
                    connection = channels.connections.get(number)
                    if connection is not None and connection.topic == topic:
                        yield MessagePlace(start, number, index), data
            elif isinstance(record, Schema):
                channels.add_schema(record)
            else:
                channels.add_channel(record)


def read_placed_message(path: Path, place: MessagePlace) -> bytes:
    """Read one message again; raises `InputError` where the file has changed."""
    index = -1
    with open_for_reading(path) as file:
        file.seek(place.offset)
        for record in read_records_from(file, path.name, _ignored):
            for number, data, *_ in record if isinstance(record, list) else ():
                index += number == place.connection
                if number == place.connection and index == place.number:
                    return data
    raise InputError(f"{path} has changed: a message at byte {place.offset} is not there any more")


def _ignored(text: str) -> None:
    """Notes are those of the reader of poses."""


class _Channels:
    """The channels of one file. ``connections``: those read so far, by the channel's number."""

    def __init__(self, name: str, note: Callable[[str], None]) -> None:
        self.connections: dict[int, Connection] = {}
        self._name = name
        self._note = note
        self._schemas: dict[int, Schema] = {0: _NO_SCHEMA}
        self._distinct: dict[tuple[str, str, bytes], Schema] = {}
        self._left_bytes = _MAX_SCHEMA_BYTES
        # A recording may repeat its channels: the same channel gives the same connection.
        self._known: dict[tuple[object, ...], Connection] = {}

    def add_schema(self, schema: Schema) -> None:
        """Add or replace the schema of a number."""
        if len(schema.data) > MAX_DEFINITION_BYTES:
            self._note(
                f"{self._name}: the definition of {schema.name[:60]} has {len(schema.data)} bytes "
                f"and is not read; expected {MAX_DEFINITION_BYTES} or less"
            )
            schema = Schema(id=schema.id, data=b"", encoding="", name=schema.name)
        content = (schema.name, schema.encoding, schema.data)
        if content not in self._distinct:
            self._left_bytes -= len(schema.data)
        self._schemas[schema.id] = self._distinct.setdefault(content, schema)
        if len(self._distinct) > _MAX_SCHEMAS or self._left_bytes < 0:
            raise InputError(
                f"{self._name} defines too many message types; expected up to {_MAX_SCHEMAS} in "
                f"{_MAX_SCHEMA_BYTES} bytes"
            )

    def add_channel(self, channel: Channel) -> None:
        """Add or replace the channel of a number; without its schema it is not used."""
        schema = self._schemas.get(channel.schema_id)
        if schema is None:
            return
        pairs = tuple(sorted(channel.metadata.items()))
        # `_distinct` holds every schema, so that none gets the identity of another.
        key = (channel.topic, id(schema), channel.message_encoding, pairs)
        connection = self._known.get(key)
        if connection is None:
            connection = self._known[key] = Connection(
                channel.topic, schema.name, schema.data, schema.encoding,
                channel.message_encoding, dict(channel.metadata),
            )  # fmt: skip
        self.connections[channel.id] = connection
        if len(self._known) > MAX_CONNECTIONS:
            raise InputError(
                f"{self._name} has more than {MAX_CONNECTIONS} topics; "
                f"expected {MAX_CONNECTIONS} or fewer"
            )
