"""STRING messages: a text of a device, such as ``on`` or ``off``.

`wire` says why the messages of pyigtl are not used.
"""

import struct

from app.igtl.errors import IgtlContentError
from app.igtl.wire import Header, read_message

MAX_STRING_BODY_BYTES = 4096

_HEAD = struct.Struct(">HH")
_ENCODINGS = {3: "ascii", 106: "utf-8"}
"""Character sets by their number (IANA MIBenum)."""


def read_string(header: Header, body: bytes) -> tuple[str, str]:
    """The device and the text of a STRING message.

    Raises `IgtlContentError` for another content and `IgtlChecksumError` for a wrong checksum.
    """
    message = read_message(header, body)
    try:
        encoding, length = _HEAD.unpack_from(message.content)
        data = message.content[_HEAD.size : _HEAD.size + length]
        if len(data) != length or encoding not in _ENCODINGS:
            raise IgtlContentError(
                f"STRING has {len(data)} bytes in encoding {encoding}; expected {length} in "
                f"{' or '.join(map(str, _ENCODINGS))}"
            )
        return message.device, data.decode(_ENCODINGS[encoding])
    except (struct.error, UnicodeDecodeError) as error:
        raise IgtlContentError(f"STRING of {len(body)} bytes: {error}") from error


def pack_string(text: str) -> bytes:
    """The content of a STRING message in UTF-8."""
    data = text.encode()
    return _HEAD.pack(106, len(data)) + data
