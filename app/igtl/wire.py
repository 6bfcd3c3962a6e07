"""OpenIGTLink messages to and from bytes, as far as tracking needs them. Nothing of a file, a
socket or ROS.

The layout is that of the protocol's own pages (version 3, headers of version 1 and 2): everything
big-endian; 58 bytes of header with the time as 32.32 fixed point; a body that from header version
2 on begins with sizes and ends with metadata. Only the checksum (CRC-64, ECMA-182) is pyigtl's,
whose messages have their times in floating point (a quarter of a microsecond off today), do not
know TDATA and are read without looking at the checksum.
"""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from pyigtl.messages import CRC64

from app.geometry import NS_PER_S
from app.igtl.errors import IgtlChecksumError, IgtlContentError, IgtlFramingError

HEADER_BYTES = 58
MOST_BODY_BYTES = 1 << 16
"""A TDATA message of 500 instruments with their metadata: nothing larger is read."""

_MOST_SKIPPED_BYTES = 1 << 30
"""The largest image that may pass unread; a larger number is no size of anything."""

_HEADER = struct.Struct(">H12s20sQQQ")
_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")
_COUNT = struct.Struct(">H")
_START_TDATA = struct.Struct(">I32s")
_TYPE = re.compile(rb"[A-Z0-9_]{1,12}\0*")
_ENCODINGS = {3: "ascii", 106: "utf-8"}
"""Numbers of the character sets (IANA MIBenum) that the protocol names."""


@dataclass(frozen=True, slots=True)
class Header:
    """What stands before a body; ``stamp_ns`` is 0 where the sender gave no time."""

    version: int
    type: str
    device: bytes
    stamp_ns: int
    body_bytes: int
    checksum: int


@dataclass(frozen=True, slots=True)
class Message:
    """A message that has passed its checksum: content and metadata apart."""

    type: str
    device: str
    stamp_ns: int
    content: bytes
    metadata: Mapping[str, str]


def read_header(header: bytes) -> Header:
    """The header in 58 bytes; `IgtlFramingError` for others that cannot be one."""
    version, kind, device, time, size, checksum = _HEADER.unpack(header)
    if not 1 <= version <= 3 or not _TYPE.fullmatch(kind) or size > _MOST_SKIPPED_BYTES:
        raise IgtlFramingError(
            f"{header[:14].hex(' ')} ... begins no OpenIGTLink message: version 1 to 3, a type of "
            f"capital letters and a body of at most {_MOST_SKIPPED_BYTES} bytes wanted"
        )
    return Header(
        version, kind.rstrip(b"\0").decode(), device.rstrip(b"\0"), stamp_ns(time), size, checksum
    )


def stamp_ns(time: int) -> int:
    """The protocol's 64 bits, seconds and their 2^32nd parts, to the nearest nanosecond."""
    return (time * NS_PER_S + (1 << 31)) >> 32


def read_message(header: Header, body: bytes) -> Message:
    """A whole message; `IgtlChecksumError` or `IgtlContentError` when the body is no good."""
    if CRC64(body) != header.checksum:
        raise IgtlChecksumError(
            f"{header.type} of {len(body)} bytes: checksum {CRC64(body):016x} "
            f"is not the header's {header.checksum:016x}"
        )
    try:
        device = header.device.decode("ascii")
        if header.version == 1:
            return Message(header.type, device, header.stamp_ns, body, {})
        extended, heads, values, _ = _EXTENDED.unpack_from(body)
        end = len(body) - heads - values
        if not _EXTENDED.size <= extended <= end:
            raise IgtlContentError(
                f"{header.type} of {len(body)} bytes has parts of {extended}, {heads} and {values}"
            )
        metadata = _metadata(body[end : end + heads], body[end + heads :]) if heads else {}
    except (struct.error, UnicodeDecodeError) as error:
        raise IgtlContentError(f"{header.type} of {len(body)} bytes: {error}") from error
    return Message(header.type, device, header.stamp_ns, body[extended:end], metadata)


def start_tracking_request() -> bytes:
    """What a PLUS server wants to hear before it tells all that it knows.

    It answers in the highest header version that its client has spoken (statuses need 2), and
    sends TDATA to those alone who have asked for it: ``STT_TDATA``, as fast as there is something,
    in the server's own coordinates.
    """
    body = _EXTENDED.pack(_EXTENDED.size, _COUNT.size, 0, 0) + _START_TDATA.pack(0, b"")
    body += _COUNT.pack(0)
    return _HEADER.pack(2, b"STT_TDATA", b"", 0, len(body), CRC64(body)) + body


def _metadata(heads: bytes, values: bytes) -> dict[str, str]:
    (count,) = _COUNT.unpack_from(heads)
    if _COUNT.size + count * _ENTRY.size > len(heads):
        raise IgtlContentError(f"metadata of {len(heads)} bytes cannot hold {count} entries")
    metadata, place = {}, 0
    for key_bytes, encoding, value_bytes in _ENTRY.iter_unpack(
        heads[_COUNT.size : _COUNT.size + count * _ENTRY.size]
    ):
        middle, end = place + key_bytes, place + key_bytes + value_bytes
        if end > len(values):
            raise IgtlContentError(f"metadata entry ends at {end} of {len(values)} bytes")
        # Values that are neither ASCII nor UTF-8 are none of those that are looked for.
        if encoding in _ENCODINGS:
            key = values[place:middle].decode("utf-8")
            metadata[key] = values[middle:end].decode(_ENCODINGS[encoding])
        place = end
    return metadata
