"""Mutations of YAML: tags, anchors, aliases, merge keys, nesting and keys."""

import re
from random import Random

from benchmarks.fuzz.mutators.text import TEXT

_VALUE = re.compile(rb"(?<=[:,\[-] )[^\s,\]}{\[][^,\]}\n]*")
_TAGS = (
    *(
        b"!!timestamp ",
        b"!!timestamp 2001-12-14",
        b"!!binary ",
        b"!!binary x",
        b"!!int ",
        b"!!int x",
    ),
    *(
        b"!!float ",
        b"!!float .",
        b"!!bool ",
        b"!!bool x",
        b"!!null ",
        b"!!set {a}",
        b"!!omap [a: 1]",
    ),
    *(b"!!pairs [a: 1]", b"!!map ", b"!!seq ", b"!!str ", b"!!python/object:os.system ", b"!x "),
    *(b"!!merge ", b"!!value =", b"!<tag:yaml.org,2002:int> ", b"!!timestamp 9999-99-99", b"! "),
    *(b"2001-99-99", b"2001-12-14t21:59:43.10-05:00", b"0o17", b"0b1", b"-0b1", b"+.inf", b"1:60"),
    *(
        b"1:99:99.9",
        b"~",
        b"=",
        b"<<",
        b"yes",
        b"*a",
        b"&a ",
        b"&a *a",
        b"|",
        b">",
        b"? ",
        b"- - - ",
    ),
)


def tag_value(data: bytes, random: Random) -> bytes:
    """Put a tag, or a value of another type, before or in the place of a value."""
    found = _VALUE.search(data, random.randrange(len(data) + 1))
    if found is None:
        return data
    rest = found.start() if random.random() < 0.5 else found.end()
    return data[: found.start()] + random.choice(_TAGS) + data[rest:]


def add_aliases(data: bytes, random: Random) -> bytes:
    """Add lists of aliases of lists of aliases (the "billion laughs" of YAML)."""
    width, depth = random.choice(((2, 30), (9, 9), (50, 3), (3, 12), (500, 2)))
    lines = [b"a0: &a0 [%s]" % b",".join([b"1.0"] * width)]
    for level in range(1, depth):
        items = b",".join([b"*a%d" % (level - 1)] * width)
        lines.append(b"a%d: &a%d [%s]" % (level, level, items))
    last = b"*a%d" % (depth - 1)
    found = _VALUE.search(data, random.randrange(len(data) + 1))
    if found is not None and random.random() < 0.7:
        data = data[: found.start()] + last + data[found.end() :]
    return b"\n".join(lines) + b"\n" + data


def alias_value(data: bytes, random: Random) -> bytes:
    """Give one value an anchor and use it in the place of another."""
    found = sorted(
        (each.start(), each.end())
        for each in (_VALUE.search(data, random.randrange(len(data) + 1)) for _ in range(2))
        if each is not None
    )
    if len(found) < 2 or found[0] == found[1]:
        return data
    (start, _), (second, end) = found
    return data[:start] + b"&z " + data[start:second] + b"*z" + data[end:]


def complex_key(data: bytes, random: Random) -> bytes:
    """Insert a line with an unusual key or document structure."""
    lines = data.split(b"\n")
    line = random.choice(
        (b"[a]: 1", b"{a: 1}: 1", b"? [a]\n: 1", b"<<: {a: 1}", b"~: 1", b"1: 1", b".nan: 1",
         b"---", b"...", b"%YAML 9.9", b"%TAG ! x", b"\t- x", b"a: b: c", b"'", b'"\\x', b"- " * 99)
    )  # fmt: skip
    lines.insert(random.randrange(len(lines) + 1), line)
    return b"\n".join(lines)


YAML = (*TEXT, *(tag_value,) * 6, *(alias_value,) * 3, add_aliases, complex_key, complex_key)
"""For YAML documents."""
