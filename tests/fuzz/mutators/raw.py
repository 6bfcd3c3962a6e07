"""Mutations of bytes, for every format: flips, cuts, copies, and numbers of edge values."""

import struct
from collections.abc import Callable
from random import Random

Mutator = Callable[[bytes, Random], bytes]
"""Returns a changed copy of a document. One that raises changes nothing."""

_INTEGERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_LONG_INTEGERS = (0, 1, 2**31, 2**32, 2**53, 2**63 - 1, 2**63, 2**64 - 1)
_FLOATS = (0.0, -0.0, float("nan"), float("inf"), -float("inf"), 1e-310, 1e38, 3.4e38, 1e308)


def flip_bits(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.randint(1, 4)):
        changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def set_byte(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data))
    return data[:at] + bytes([random.choice((0, 1, 10, 13, 32, 127, 128, 255))]) + data[at + 1 :]


def truncate(data: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data))]


def delete_range(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data))
    return data[:at] + data[at + random.choice((1, 2, 4, 16, 256, len(data) // 4)) :]


def repeat_range(data: bytes, random: Random) -> bytes:
    at = random.randrange(len(data))
    part = data[at : at + random.choice((1, 4, 32, 200))]
    times = random.choice((1, 2, 10, 1000 if random.random() < 0.1 else 20))
    return data[:at] + part * times + data[at:]


def move_range(data: bytes, random: Random) -> bytes:
    """Copy a range over another place."""
    source, target = random.randrange(len(data)), random.randrange(len(data))
    part = data[source : source + random.choice((2, 8, 64))]
    return data[:target] + part + data[target + len(part) :]


def set_integer(data: bytes, random: Random) -> bytes:
    """Overwrite 2, 4 or 8 bytes, mostly near the beginning, with an integer of an edge value."""
    size = random.choice((2, 4, 4, 4, 8))
    near = random.random() < 0.6
    at = random.randrange(min(len(data), 400) if near else len(data))
    at = min(at - at % random.choice((1, 2, 4)), len(data) - size)
    old = int.from_bytes(data[at : at + size], "little")
    values = _LONG_INTEGERS if size == 8 else _INTEGERS
    value = random.choice((*values, old + 1, old - 1, old * 2, len(data))) % (1 << 8 * size)
    return data[:at] + value.to_bytes(size, random.choice(("little", "big"))) + data[at + size :]


def set_float(data: bytes, random: Random) -> bytes:
    """Overwrite 4 or 8 bytes with a floating-point number that is not finite, or extreme."""
    packed = struct.pack(random.choice("<>") + random.choice("fd"), random.choice(_FLOATS))
    at = random.randrange(len(data) - len(packed) + 1)
    return data[:at] + packed + data[at + len(packed) :]


RAW: tuple[Mutator, ...] = (
    *(flip_bits, set_byte, truncate, delete_range, repeat_range, move_range),
    *(set_integer, set_float),
)
"""For binary formats."""
