"""Split a byte stream into OpenIGTLink messages; encode and decode them. No input or output.

The layout follows the protocol specification (version 3; header versions 1 and 2): big-endian, a
header of 58 bytes with the time as 32.32 fixed point, and a body that from header version 2 on
begins with sizes and ends with metadata. Only the checksum (CRC-64, ECMA-182) comes from pyigtl.
The messages of pyigtl store times as floating point (0.25 us error today), do not support TDATA
and do not verify the checksum.
"""

import re
import struct
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from pyigtl.messages import CRC64

from app.geometry import NS_PER_S, MarginGuardError, Stamp

HEADER_BYTES = 58
MAX_BODY_BYTES = 1 << 16
"""Room for a TDATA message of 500 tools with their metadata. Larger bodies are not read."""

MAX_STRING_BODY_BYTES = 4096
_MAX_SKIPPED_BYTES = 1 << 30
"""Largest body that is skipped, such as an image. A larger size means an invalid header."""

_HEADER = struct.Struct(">H12s20sQQQ")
_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")
_COUNT = struct.Struct(">H")
_STRING_HEAD = struct.Struct(">HH")
_START_TDATA = struct.Struct(">I32s")
_TYPE = re.compile(rb"[A-Z0-9_]{1,12}\0*")
_ENCODINGS = {3: "ascii", 106: "utf-8"}
"""Character sets of the protocol by their number (IANA MIBenum)."""

_MAX_CHARS = 200
_LAST_SECOND = 2**31 - 1  # of a ROS time


class IgtlError(MarginGuardError):
    """Base class: invalid settings, or the client failed."""


class IgtlFramingError(IgtlError):
    """Invalid header; the start of the next message is unknown."""


class IgtlChecksumError(IgtlError):
    """The body does not match the checksum in the header."""


class IgtlContentError(IgtlError):
    """The sizes of the parts of a body are inconsistent."""


class IgtlStampError(IgtlError):
    """The message has no valid time stamp."""


class IgtlLimitError(IgtlError):
    """A size or a count exceeds its limit."""


@dataclass(frozen=True, slots=True)
class Header:
    """Header of a message; ``stamp_ns`` is 0 if the sender gave no time."""

    version: int
    type: str
    device: bytes
    stamp_ns: int
    body_bytes: int
    checksum: int


@dataclass(frozen=True, slots=True)
class Message:
    """A message with a valid checksum, split into content and metadata."""

    type: str
    device: str
    stamp_ns: int
    content: bytes
    metadata: Mapping[str, str]

    @property
    def stamp(self) -> Stamp:
        """The time of the message. Raises `IgtlStampError` for none that a ROS time can have."""
        if not 0 < self.stamp_ns < _LAST_SECOND * NS_PER_S:
            raise IgtlStampError(
                f"{self.type} {self.device!r} has the time {self.stamp_ns} ns; "
                f"expected more than 0 and less than {_LAST_SECOND} s"
            )
        return Stamp(self.stamp_ns)


def read_header(header: bytes) -> Header:
    """Decode a header of 58 bytes; raises `IgtlFramingError` if it is invalid."""
    version, kind, device, time, size, checksum = _HEADER.unpack(header)
    if not 1 <= version <= 3 or not _TYPE.fullmatch(kind) or size > _MAX_SKIPPED_BYTES:
        raise IgtlFramingError(
            f"OpenIGTLink header begins with {header[:14].hex(' ')}; expected version 1 to 3, a "
            f"type of capital letters and a body of at most {_MAX_SKIPPED_BYTES} bytes"
        )
    return Header(
        version, kind.rstrip(b"\0").decode(), device.rstrip(b"\0"), stamp_ns(time), size, checksum
    )


def stamp_ns(time: int) -> int:
    """Convert the protocol's time (32.32 fixed point seconds) to the nearest nanosecond."""
    return (time * NS_PER_S + (1 << 31)) >> 32


def read_message(header: Header, body: bytes) -> Message:
    """Decode a body; raises `IgtlChecksumError` or `IgtlContentError` if it is invalid."""
    if CRC64(body) != header.checksum:
        raise IgtlChecksumError(
            f"{header.type} of {len(body)} bytes has checksum {CRC64(body):016x}; "
            f"expected {header.checksum:016x}, as in the header"
        )
    try:
        device = header.device.decode("ascii")
        if header.version == 1:
            return Message(header.type, device, header.stamp_ns, body, {})
        extended, heads, values, _ = _EXTENDED.unpack_from(body)
        end = len(body) - heads - values
        if not _EXTENDED.size <= extended <= end:
            raise IgtlContentError(
                f"{header.type} of {len(body)} bytes has parts of {extended}, {heads} and {values} "
                "bytes; expected parts that fit into the body"
            )
        metadata = _metadata(body[end : end + heads], body[end + heads :]) if heads else {}
    except (struct.error, UnicodeDecodeError) as error:
        raise IgtlContentError(f"{header.type} of {len(body)} bytes: {error}") from error
    return Message(header.type, device, header.stamp_ns, body[extended:end], metadata)


def pack_message(
    kind: str,
    device: str,
    stamp_ns: int,
    content: bytes,
    metadata: Mapping[str, str] | None = None,
) -> bytes:
    """Encode a message of header version 1; with ``metadata``, in UTF-8, of version 2.

    Raises `IgtlContentError` for a device name that is not 1 to 20 ASCII characters.
    """
    version, body = 1, content
    if metadata is not None:
        pairs = [(key.encode(), value.encode()) for key, value in metadata.items()]
        heads = _COUNT.pack(len(pairs))
        heads += b"".join(_ENTRY.pack(len(key), 106, len(value)) for key, value in pairs)
        values = b"".join(key + value for key, value in pairs)
        extended = _EXTENDED.pack(_EXTENDED.size, len(heads), len(values), 0)
        version, body = 2, extended + content + heads + values
    name = device.encode("ascii", "replace")
    if not 1 <= len(name) <= 20 or name.decode() != device:
        raise IgtlContentError(f"device is {device!r}; expected 1 to 20 ASCII characters")
    time = ((stamp_ns << 32) + NS_PER_S // 2) // NS_PER_S
    return _HEADER.pack(version, kind.encode(), name, time, len(body), CRC64(body)) + body


def start_tracking_request() -> bytes:
    """Encode the ``STT_TDATA`` message that a client sends after connecting.

    A PLUS server replies in the highest header version that the client has used (a status needs
    version 2), and sends TDATA only to clients that requested it. The request asks for the highest
    rate and for the server's own coordinates.
    """
    body = _EXTENDED.pack(_EXTENDED.size, _COUNT.size, 0, 0) + _START_TDATA.pack(0, b"")
    body += _COUNT.pack(0)
    return _HEADER.pack(2, b"STT_TDATA", b"", 0, len(body), CRC64(body)) + body


def _metadata(heads: bytes, values: bytes) -> dict[str, str]:
    (count,) = _COUNT.unpack_from(heads)
    if _COUNT.size + count * _ENTRY.size > len(heads):
        raise IgtlContentError(
            f"metadata header of {len(heads)} bytes claims {count} entries; "
            f"expected at most {(len(heads) - _COUNT.size) // _ENTRY.size}"
        )
    metadata, offset = {}, 0
    for key_bytes, encoding, value_bytes in _ENTRY.iter_unpack(
        heads[_COUNT.size : _COUNT.size + count * _ENTRY.size]
    ):
        middle, end = offset + key_bytes, offset + key_bytes + value_bytes
        if end > len(values):
            raise IgtlContentError(
                f"metadata entry ends at byte {end}; expected at most {len(values)}"
            )
        # Entries in other encodings are skipped: the ones that are used are ASCII or UTF-8.
        if encoding in _ENCODINGS:
            key = values[offset:middle].decode("utf-8")
            metadata[key] = values[middle:end].decode(_ENCODINGS[encoding])
        offset = end
    return metadata


def read_string(header: Header, body: bytes) -> tuple[str, str]:
    """The device and the text of a STRING message, such as ``on`` or ``off``.

    Raises `IgtlContentError` for another content and `IgtlChecksumError` for a wrong checksum.
    """
    message = read_message(header, body)
    try:
        encoding, length = _STRING_HEAD.unpack_from(message.content)
        data = message.content[_STRING_HEAD.size : _STRING_HEAD.size + length]
        if len(data) != length or encoding not in _ENCODINGS:
            raise IgtlContentError(
                f"STRING has {len(data)} bytes in encoding {encoding}; expected {length} in "
                f"{' or '.join(map(str, _ENCODINGS))}"
            )
        return message.device, data.decode(_ENCODINGS[encoding])
    except (struct.error, UnicodeDecodeError) as error:
        raise IgtlContentError(f"STRING of {len(body)} bytes: {error}") from error


class Refusals:
    """Counts refused messages by type of error and keeps the latest error message."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.last = ""

    def add(self, error: Exception) -> None:
        """Count ``error``; its message is truncated because it may quote network data."""
        self.counts[type(error).__name__] += 1
        self.last = str(error)[:_MAX_CHARS]


Unread = Callable[[Header, bytes], None]
"""Takes a complete message as it came, with its checksum not yet verified."""


class MessageStream:
    """``stream.feed(data)`` returns the messages of ``types`` that are now complete.

    ``unread`` are functions by type, each with a limit of its own for the body: they take those
    messages as they came, so that another thread can read them. Bodies of other types and bodies
    above ``max_body_bytes`` are skipped without being stored, so the buffer holds one body and one
    chunk of data at most. ``complete`` counts all messages that
    have passed. Invalid bodies are added to ``refusals``. An invalid header raises
    `IgtlFramingError`; the stream cannot be used afterwards.
    """

    def __init__(
        self,
        types: Collection[str],
        refusals: Refusals,
        max_body_bytes: int = MAX_BODY_BYTES,
        unread: Mapping[str, tuple[Unread, int]] | None = None,
    ) -> None:
        self._unread = unread or {}
        self.complete = 0
        self.ignored = 0
        self._max_bytes = {
            **dict.fromkeys(types, max_body_bytes),
            **{kind: limit for kind, (_, limit) in self._unread.items()},
        }
        self._refusals = refusals
        self._buffer = bytearray()
        self._header: Header | None = None
        self._to_skip = 0

    def feed(self, data: bytes) -> list[Message]:
        """Add received bytes, of any length, and return the complete messages."""
        self._buffer += data
        messages: list[Message] = []
        while self._advance(messages):
            pass
        return messages

    def _advance(self, messages: list[Message]) -> bool:
        if self._to_skip:
            skipped = min(self._to_skip, len(self._buffer))
            del self._buffer[:skipped]
            self._to_skip -= skipped
            self.complete += not self._to_skip
            return not self._to_skip and bool(self._buffer)
        if self._header is None:
            if len(self._buffer) < HEADER_BYTES:
                return False
            self._begin(read_header(self._take(HEADER_BYTES)))
            return True
        if len(self._buffer) < self._header.body_bytes:
            return False
        header, self._header = self._header, None
        self.complete += 1
        if header.type in self._unread:
            self._unread[header.type][0](header, self._take(header.body_bytes))
            return True
        try:
            messages.append(read_message(header, self._take(header.body_bytes)))
        except IgtlError as error:
            self._refusals.add(error)
        return True

    def _begin(self, header: Header) -> None:
        max_bytes = self._max_bytes.get(header.type)
        if max_bytes is not None and header.body_bytes <= max_bytes:
            self._header = header
            return
        self._to_skip = header.body_bytes
        self.complete += not header.body_bytes
        if max_bytes is not None:
            self._refusals.add(
                IgtlLimitError(
                    f"{header.type} has a body of {header.body_bytes} bytes; "
                    f"expected at most {max_bytes}"
                )
            )
        else:
            self.ignored += 1

    def _take(self, count: int) -> bytes:
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken
