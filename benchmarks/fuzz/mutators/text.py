"""Mutations of text: its numbers, words, lines and encoding."""

import re
from random import Random

from benchmarks.fuzz.mutators.raw import delete_range, flip_bits, set_byte, truncate

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


def replace_number(data: bytes, random: Random) -> bytes:
    """Replace a number of the text by an edge value."""
    return _replace(_NUMBER, random.choice(NUMBERS), data, random)


def scale_number(data: bytes, random: Random) -> bytes:
    """Multiply a number of the text by a factor, or change its last digit."""
    found = _nearby(_NUMBER, data, random)
    if found is None:
        return data
    try:
        value = float(found.group())
    except ValueError:
        return data
    factor = random.choice((-1.0, 0.0, 1e-9, 0.5, 2.0, 10.0, 1e6, 1e30))
    text = f"{value * factor:g}".encode() if random.random() < 0.7 else b"%d" % random.randrange(99)
    return data[: found.start()] + text + data[found.end() :]


def replace_word(data: bytes, random: Random) -> bytes:
    """Replace a word by an edge value, or by another word of the text."""
    other = _nearby(_WORD, data, random)
    words = WORDS if other is None or random.random() < 0.5 else (other.group(),)
    return _replace(_WORD, random.choice(words), data, random)


def delete_word(data: bytes, random: Random) -> bytes:
    """Delete a word or a number."""
    return _replace(random.choice((_WORD, _NUMBER)), b"", data, random)


def delete_line(data: bytes, random: Random) -> bytes:
    """Delete a line."""
    lines = data.split(b"\n")
    del lines[random.randrange(len(lines))]
    return b"\n".join(lines)


def repeat_line(data: bytes, random: Random) -> bytes:
    """Repeat a line, sometimes very often."""
    lines = data.split(b"\n")
    at = random.randrange(len(lines))
    times = random.choice((2, 2, 3, 20, 2000 if random.random() < 0.1 else 5))
    lines[at : at + 1] = [lines[at]] * times
    return b"\n".join(lines)


def swap_lines(data: bytes, random: Random) -> bytes:
    """Exchange two lines."""
    lines = data.split(b"\n")
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def change_encoding(data: bytes, random: Random) -> bytes:
    """Write the text in another encoding, with a byte order mark, or with other line ends."""
    text = data.decode("utf-8", "replace")
    match random.randrange(5):
        case 0:
            return text.encode("utf-16")
        case 1:
            return b"\xef\xbb\xbf" + data
        case 2:
            return data.replace(b"\n", random.choice((b"\r\n", b"\r", b"\0", b" ")))
        case 3:
            return text.encode("utf-32", "replace")
        case _:
            return text.encode("utf-16-be")


def nest(data: bytes, random: Random) -> bytes:
    """Insert opening signs, up to 100 000, sometimes with their closing signs."""
    opening, closing = random.choice(((b"[", b"]"), (b"{", b"}"), (b"(", b")"), (b"<a>", b"</a>")))
    depth = random.choice((2, 10, 70, 1000, 100_000 if random.random() < 0.1 else 20))
    at = random.randrange(len(data) + 1)
    if random.random() < 0.3:
        return data[:at] + opening * depth + data[at:]
    return data[:at] + opening * depth + closing * depth + data[at:]


def _nearby(pattern: re.Pattern[bytes], data: bytes, random: Random) -> re.Match[bytes] | None:
    """First match behind a random place; none where the text ends before."""
    return pattern.search(data, random.randrange(len(data) + 1))


def _replace(pattern: re.Pattern[bytes], text: bytes, data: bytes, random: Random) -> bytes:
    found = _nearby(pattern, data, random)
    return data if found is None else data[: found.start()] + text + data[found.end() :]


TEXT = (
    *(replace_number, replace_number, scale_number, replace_word, replace_word, delete_word),
    *(delete_line, repeat_line, swap_lines, change_encoding, nest),
    *(flip_bits, set_byte, truncate, delete_range),
)
"""For text formats of any structure."""
