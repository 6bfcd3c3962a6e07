"""Mutations of YAML: tags, anchors, aliases, merge keys, nesting and keys."""

import re
from random import Random

from tests.fuzz.mutators.text import TEXT, nearby, splice

_VALUE = re.compile(rb"(?<=[:,\[-] )[^\s,\]}{\[][^,\]}\n]*")
_TAGS = (
    b"!!timestamp |!!timestamp 2001-12-14|!!binary |!!binary x|!!int |!!int x|!!float |!!float .|"
    b"!!bool |!!bool x|!!null |!!set {a}|!!omap [a: 1]|!!pairs [a: 1]|!!map |!!seq |!!str |"
    b"!!python/object:os.system |!x |!!merge |!!value =|!<tag:yaml.org,2002:int> |"
    b"!!timestamp 9999-99-99|! |2001-99-99|2001-12-14t21:59:43.10-05:00|0o17|0b1|-0b1|+.inf|1:60|"
    b"1:99:99.9|~|=|<<|yes|*a|&a |&a *a|>|? |- - - "
).split(b"|")
_LINES = (
    *(b"[a]: 1", b"{a: 1}: 1", b"? [a]\n: 1", b"<<: {a: 1}", b"~: 1", b"1: 1", b".nan: 1", b"---"),
    *(b"...", b"%YAML 9.9", b"%TAG ! x", b"\t- x", b"a: b: c", b"'", b'"\\x', b"- " * 99),
)


def tag_value(data: bytes, random: Random) -> bytes:
    """Put a tag, or a value of another type, before or in the place of a value."""
    found = nearby(_VALUE, data, random)
    return splice(found, random.choice(_TAGS) + random.choice((b"", found.group())))


def add_aliases(data: bytes, random: Random) -> bytes:
    """Add lists of aliases of lists of aliases (the "billion laughs" of YAML)."""
    width, depth = random.choice(((2, 30), (9, 9), (50, 3), (3, 12), (500, 2)))
    lines = [b"a0: &a0 [%s]" % b",".join([b"1.0"] * width)]
    for level in range(1, depth):
        items = b",".join([b"*a%d" % (level - 1)] * width)
        lines.append(b"a%d: &a%d [%s]" % (level, level, items))
    if random.random() < 0.7:
        data = splice(nearby(_VALUE, data, random), b"*a%d" % (depth - 1))
    return b"\n".join(lines) + b"\n" + data


def alias_value(data: bytes, random: Random) -> bytes:
    """Give one value an anchor and use it in the place of another."""
    found = [nearby(_VALUE, data, random).span() for _ in range(2)]
    (start, _), (second, end) = sorted(found)
    return data[:start] + b"&z " + data[start:second] + b"*z" + data[end:]


def complex_key(data: bytes, random: Random) -> bytes:
    """Insert a line with an unusual key or document structure."""
    lines = data.split(b"\n")
    lines.insert(random.randrange(len(lines) + 1), random.choice(_LINES))
    return b"\n".join(lines)


YAML = (*TEXT, *(tag_value,) * 6, *(alias_value,) * 3, add_aliases, complex_key, complex_key)
