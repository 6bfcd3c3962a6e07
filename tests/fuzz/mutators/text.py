"""Mutations of text: its numbers, words, lines and encoding."""

import re
from random import Random

from tests.fuzz.mutators.raw import Mutator, delete_range, flip_bits, set_byte, truncate

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")

NUMBERS = (
    *b"0 -0 -1 1 2 0.0 1e-320 1e308 -1e308 1e309 1e400 nan NaN .nan inf -inf .inf Infinity".split(),
    *b"x 1_000 010 0x10 1:30 1,5 1e3 2147483648 4294967296 9223372036854775808 1e99999999".split(),
    *b"99999999999999999999 true null [] {} - + . e".split(),
    *(b"", b"1 2", b"9" * 309, b"9" * 4307, "\N{ARABIC-INDIC DIGIT ONE}".encode()),
)
"""Texts in the place of a number."""

WORDS = (
    *b"x .. ../.. / /etc/passwd ~ %s%n null true nan __class__ CON &amp; ' { \\".split(),
    *(b"", b" ", b"\0", b"\r", b"\n", b"\t", b'"', b"\x1b[31m", b"\xff\xfe"),
    *("\N{LATIN SMALL LETTER E WITH ACUTE}".encode(), "\N{RIGHT-TO-LEFT OVERRIDE}".encode()),
    *(b"a" * 300, b"a" * 100_000, b"a/" * 300),
)
"""Texts in the place of a word."""


def nearby(pattern: re.Pattern[bytes], data: bytes, random: Random) -> re.Match[bytes]:
    """First match behind a random place. Raises `ValueError` where there is none."""
    found = pattern.search(data, random.randrange(len(data) + 1))
    if found is None:
        raise ValueError("no match")
    return found


def splice(found: re.Match[bytes], text: bytes) -> bytes:
    """The document with ``text`` in the place of a match."""
    return found.string[: found.start()] + text + found.string[found.end() :]


def replace_number(data: bytes, random: Random) -> bytes:
    return splice(nearby(_NUMBER, data, random), random.choice(NUMBERS))


def scale_number(data: bytes, random: Random) -> bytes:
    found = nearby(_NUMBER, data, random)
    if random.random() < 0.3:
        return splice(found, b"%d" % random.randrange(99))
    factor = random.choice((-1.0, 0.0, 1e-9, 0.5, 2.0, 10.0, 1e6, 1e30))
    return splice(found, f"{float(found.group()) * factor:g}".encode())


def replace_word(data: bytes, random: Random) -> bytes:
    """Replace a word by an edge value, or by another word of the text."""
    other = nearby(_WORD, data, random).group()
    return splice(nearby(_WORD, data, random), random.choice((*WORDS, *[other] * len(WORDS))))


def delete_word(data: bytes, random: Random) -> bytes:
    return splice(nearby(random.choice((_WORD, _NUMBER)), data, random), b"")


def change_lines(data: bytes, random: Random) -> bytes:
    """Delete a line, repeat it, sometimes very often, or exchange it with another one."""
    lines = data.split(b"\n")
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(3):
        case 0:
            del lines[a]
        case 1:
            times = random.choice((2, 2, 3, 20, 2000 if random.random() < 0.1 else 5))
            lines[a:a] = [lines[a]] * times
        case _:
            lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def change_encoding(data: bytes, random: Random) -> bytes:
    """Write the text in another encoding, with a byte order mark, or with other line ends."""
    codec = random.choice(("utf-16", "utf-32", "utf-16-be", "utf-8-sig", ""))
    if codec:
        return data.decode("utf-8", "replace").encode(codec, "replace")
    return data.replace(b"\n", random.choice((b"\r\n", b"\r", b"\0", b" ")))


def nest(data: bytes, random: Random) -> bytes:
    """Insert opening signs, up to 100 000, mostly with their closing signs."""
    opening, closing = random.choice(((b"[", b"]"), (b"{", b"}"), (b"(", b")"), (b"<a>", b"</a>")))
    depth = random.choice((2, 10, 70, 1000, 100_000 if random.random() < 0.1 else 20))
    at = random.randrange(len(data) + 1)
    ends = closing * depth if random.random() < 0.7 else b""
    return data[:at] + opening * depth + ends + data[at:]


TEXT: tuple[Mutator, ...] = (
    *(replace_number, replace_number, scale_number, replace_word, replace_word, delete_word),
    *(*[change_lines] * 3, change_encoding, nest, flip_bits, set_byte, truncate, delete_range),
)
"""For text formats of any structure."""
