"""Serialised messages that differ in stamps and numbers only: the rest is serialised once.

rclpy converts a message field by field, which takes 33 us for the ten transforms of a step; to
replace the numbers in the bytes of an equal message takes 5 us.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message, serialize_message

from app.bridge.errors import BridgeError

Block = tuple[tuple[int, int], Sequence[float]]
"""A stamp in s and ns, and the numbers that belong to it."""


class NumberTemplate:
    """Bytes of the messages that ``make`` returns for blocks of ``counts`` numbers.

    ``make`` writes each block's stamp into one ``builtin_interfaces/Time`` and its numbers, in
    order, into adjacent fields of 64 bits; all else is the same for all blocks. The places are
    found by the bytes of marks, and a message with other marks proves them. Raises `BridgeError`
    for messages of another form.
    """

    def __init__(self, make: Callable[[Sequence[Block]], Any], counts: Sequence[int]) -> None:
        marks, others = _marks(counts, 1), _marks(counts, 2)
        raw = bytes(serialize_message(make(marks)))
        self._buffer = bytearray(raw)
        order = "<" if raw[1] & 1 else ">"  # of the encapsulation: CDR_LE or CDR_BE
        stamp = struct.Struct(f"{order}iI")
        self._places: list[tuple[struct.Struct, int, struct.Struct, int]] = []
        for at, numbers in marks:
            values = struct.Struct(f"{order}{len(numbers)}d")
            self._places.append(
                (stamp, _place(raw, stamp.pack(*at)), values, _place(raw, values.pack(*numbers)))
            )
        expected = make(others)
        # Not their bytes: the padding between fields is not initialised.
        if deserialize_message(self.serialized(others), type(expected)) != expected:
            raise BridgeError(
                "template of a message: other fields depend on the stamps or numbers; expected "
                "one Time and adjacent numbers of 64 bits per block"
            )
        del self._buffer[_length(self.serialized(others), expected) :]

    def serialized(self, blocks: Sequence[Block]) -> bytes:
        """Return the serialised message with these blocks, as many and as long as ``counts``."""
        buffer = self._buffer
        for (stamp, at, values, begin), (time, numbers) in zip(self._places, blocks, strict=True):
            stamp.pack_into(buffer, at, *time)
            values.pack_into(buffer, begin, *numbers)
        return bytes(buffer)


def _length(raw: bytes, message: Any) -> int:
    """Number of bytes of ``raw`` that hold ``message``.

    rclpy adds up to 8 bytes that are not initialised after an empty sequence of numbers of 64 bits.
    rosbags rejects such a message.
    """
    length = len(raw)
    while length > 4 and _decodes(raw[: length - 1], message):
        length -= 1
    return length


def _decodes(raw: bytes, message: Any) -> bool:
    try:
        return bool(deserialize_message(raw, type(message)) == message)
    except rclpy_implementation.RMWError:
        return False


def _marks(counts: Sequence[int], number: int) -> list[Block]:
    """Blocks whose stamps, 60 years from now, and numbers, above 1e100, occur nowhere else."""
    return [
        (
            (2_100_000_000 + 10 * block + number, 900_000_000 + 10 * block + number),
            [1e100 * (number + 10.0 * block + 0.001 * k) for k in range(count)],
        )
        for block, count in enumerate(counts)
    ]


def _place(raw: bytes, mark: bytes) -> int:
    """Index of the one occurrence of ``mark``; 0 for an empty one."""
    place = raw.find(mark)
    if place < 0 or (mark and raw.find(mark, place + 1) >= 0):
        raise BridgeError(
            f"template of a message: a mark occurs {raw.count(mark)} times; expected once"
        )
    return place
