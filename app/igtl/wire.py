"""Encode and decode the OpenIGTLink messages that tracking needs. No input or output.

The layout follows the protocol specification (version 3; header versions 1 and 2): big-endian, a
header of 58 bytes with the time as 32.32 fixed point, and a body that from header version 2 on
begins with sizes and ends with metadata. Only the checksum (CRC-64, ECMA-182) comes from pyigtl.
The messages of pyigtl store times as floating point (0.25 us error today), do not support TDATA
and do not verify the checksum.
"""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from pyigtl.messages import CRC64

from app.geometry import NS_PER_S
from app.igtl.errors import IgtlChecksumError, IgtlContentError, IgtlFramingError

HEADER_BYTES = 58
MAX_BODY_BYTES = 1 << 16
"""Room for a TDATA message of 500 tools with their metadata. Larger bodies are not read."""

_MAX_SKIPPED_BYTES = 1 << 30
"""Largest body that is skipped, such as an image. A larger size means an invalid header."""

_HEADER = struct.Struct(">H12s20sQQQ")
_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")
_COUNT = struct.Struct(">H")
_START_TDATA = struct.Struct(">I32s")
_TYPE = re.compile(rb"[A-Z0-9_]{1,12}\0*")
_ENCODINGS = {3: "ascii", 106: "utf-8"}
"""Character sets of the protocol by their number (IANA MIBenum)."""


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


def pack_message(kind: str, device: str, stamp_ns: int, content: bytes) -> bytes:
    """Encode a message of header version 1.

    Raises `IgtlContentError` for a device name that is not 1 to 20 ASCII characters.
    """
    return _packed(1, kind, device, stamp_ns, content)


def pack_message_with_metadata(
    kind: str, device: str, stamp_ns: int, content: bytes, metadata: Mapping[str, str]
) -> bytes:
    """Encode a message of header version 2 with ``metadata`` in UTF-8; raises as `pack_message`."""
    pairs = [(key.encode(), value.encode()) for key, value in metadata.items()]
    heads = _COUNT.pack(len(pairs))
    heads += b"".join(_ENTRY.pack(len(key), 106, len(value)) for key, value in pairs)
    values = b"".join(key + value for key, value in pairs)
    extended = _EXTENDED.pack(_EXTENDED.size, len(heads), len(values), 0)
    return _packed(2, kind, device, stamp_ns, extended + content + heads + values)


def _packed(version: int, kind: str, device: str, stamp_ns: int, body: bytes) -> bytes:
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
