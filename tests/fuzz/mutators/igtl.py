"""Mutations of OpenIGTLink messages: size and checksum of the header stay right."""

import struct
from random import Random

from pyigtl.messages import CRC64

from tests.fuzz.mutators.raw import RAW

_HEADER = struct.Struct(">H12s20sQQQ")


def change_body(data: bytes, random: Random) -> bytes:
    """Change the body of the first message."""
    version, kind, device, time, size, _ = _HEADER.unpack_from(data)
    body = data[_HEADER.size : _HEADER.size + min(size, len(data))]
    changed = random.choice(RAW)(body, random)[:100_000]
    head = _HEADER.pack(version, kind, device, time, len(changed), CRC64(changed))
    return head + changed + data[_HEADER.size + len(body) :]


IGTL = (*[change_body] * 2 * len(RAW), *RAW)
