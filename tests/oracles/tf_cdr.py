"""A second parser of ``tf2_msgs/TFMessage`` in CDR, field by field.

Independent of `app.case.messages.decoder`, which reuses the layout of earlier messages, and of
rosbags. Layout by OMG DDS-XTypes 1.3, section 7.4.1: after four bytes that give the byte order,
numbers are aligned to their size and strings carry their length with a terminating zero.
"""

import struct
from typing import Any, NamedTuple

_ORDERS = {b"\0\0": ">", b"\0\1": "<"}


class TfFields(NamedTuple):
    """One transform as it is in the message: metres, quaternion as x, y, z, w."""

    parent: str
    child: str
    ns: int
    translation_m: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


class _Cursor:
    def __init__(self, message: bytes) -> None:
        self.order, self.body, self.at = _ORDERS[message[:2]], message[4:], 0

    def take(self, code: str) -> tuple[Any, ...]:
        """Unpack the format ``code``, aligned to the size of its first number."""
        size = struct.calcsize(self.order + code[-1])
        self.at = -(-self.at // size) * size
        values = struct.unpack_from(self.order + code, self.body, self.at)
        self.at += struct.calcsize(self.order + code)
        return values

    def text(self) -> str:
        (length,) = self.take("I")
        raw = self.body[self.at : self.at + length]
        if len(raw) != length or not raw.endswith(b"\0"):
            raise ValueError("a name that is cut or has no terminating zero")
        self.at += length
        return raw[:-1].decode()


def tf_fields(message: bytes) -> list[TfFields]:
    """All transforms; `ValueError`, `KeyError` or `struct.error` for bytes that are no message."""
    cursor = _Cursor(message)
    (count,) = cursor.take("I")
    fields = []
    for _ in range(count):
        (sec,), (nanosec,) = cursor.take("i"), cursor.take("I")
        parent, child = cursor.text(), cursor.text()
        numbers = cursor.take("7d")
        fields.append(TfFields(parent, child, sec * 10**9 + nanosec, numbers[:3], numbers[3:]))
    if not 0 <= len(cursor.body) - cursor.at <= 3:
        raise ValueError("bytes after the last transform")
    return fields
