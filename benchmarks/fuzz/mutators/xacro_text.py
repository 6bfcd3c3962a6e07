"""Mutations of xacro: hostile expressions, loops of macros and of includes."""

import re
from random import Random

from benchmarks.fuzz.mutators.text import TEXT
from benchmarks.fuzz.mutators.tree import mutate_xml

_EXPRESSION = re.compile(rb"\$\{[^}]*\}")
_EXPRESSIONS = (
    *(
        b"1/0",
        b"'a'*10**10",
        b"[0]*10**10",
    ),
    *(b"().__class__.__bases__[0].__subclasses__()", b"open('/etc/passwd')"),
    *(
        b"__import__('os').system('true')",
        b"x",
        b"",
        b"1 +",
        b"'",
        b"((((" * 50,
        b"-" * 5000 + b"1",
    ),
    *(b"[" * 5000, b"lambda: 0", b"(lambda f: f(f))(lambda f: f(f))", b"xacro.load_yaml('x')"),
    *(b"xacro.load_yaml('/etc/passwd')", b"xacro.load_yaml('part.xacro')", b"'%0999999999d' % 1"),
    *(b"'{:>999999999}'.format(1)", b"xacro.fatal('x')", b"1e999"),
    *(
        b"xacro.warning('x')",
        b"xacro.error('x')",
        b"print_location()",
        b"xacro.message('x')",
        b"nan",
    ),
    *(
        b"max([])",
        b"sizes[99]",
        b"limits['x']",
        b"{}[1]",
        b"None",
        b"...",
    ),
)
_LONG_EXPRESSIONS = (
    b"10**10**8",
    b"2**2**40",
    b"sum(range(10**10))",
    b"list(range(10**10))",
    b"[x for x in range(10**9)]",
    b"' '.join(['a'] * 10**7)",
)
"""Expressions that run until their limit; few inputs have one."""

_ELEMENTS = (
    b'<xacro:include filename="arm.xacro"/>',
    b'<xacro:include filename="/etc/passwd"/>',
    b'<xacro:include filename="../*"/>',
    b'<xacro:include filename="*.xacro"/>',
    b'<xacro:include filename="/dev/zero"/>',
    b'<xacro:include filename="none" optional="true"/>',
    b'<xacro:macro name="l"><xacro:l/></xacro:macro><xacro:l/>',
    b'<xacro:macro name="l"><xacro:l/><xacro:l/></xacro:macro><xacro:l/>',
    b'<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/>'
    b'<link name="${a}"/>',
    b'<xacro:property name="p" value="${\'x\' * 1000}"/><link name="${p * 100000}"/>',
    b'<xacro:call macro="${1}"/>',
    b'<xacro:element xacro:name="a b"/>',
    b'<xacro:element xacro:name="${1}"/>',
    b'<xacro:attribute name="x" value="1"/>',
    b'<xacro:attribute name="&lt;" value="&#x1;"/>',
    b'<link name="$(find none)"/>',
    b'<link name="$(eval 2**99999999)"/>',
    b'<link name="$(env HOME)"/>',
    b'<link name="$(dirname)$(arg x)$(anon a)"/>',
    b"<xacro:unknown/>",
    b'<xacro:if value="maybe"/>',
    b'<xacro:property name="d" value="1" scope="parent"/>',
    b'<xacro:property name="a.b" value="1"/>',
    b'<xacro:property name="xacro" value="1"/>',
    b'<xacro:macro name="m" params="a:=^ b:=^|1 *c **d"/><xacro:m/>',
)


def change_expression(data: bytes, random: Random) -> bytes:
    """Replace an expression."""
    found = _EXPRESSION.search(data, random.randrange(len(data) + 1))
    if found is None:
        return data
    text = random.choice(_LONG_EXPRESSIONS if random.random() < 0.02 else _EXPRESSIONS)
    return data[: found.start()] + b"${" + text + b"}" + data[found.end() :]


def add_element(data: bytes, random: Random) -> bytes:
    """Insert an element behind another one."""
    at = data.find(b">\n", random.randrange(len(data) + 1)) + 1
    return data[:at] + random.choice(_ELEMENTS) + data[at:] if at else data


def add_macros(data: bytes, random: Random) -> bytes:
    """Insert macros that call each other: 2 to the power of 5 to 40 calls."""
    depth = 40 if random.random() < 0.05 else random.choice((3, 6))
    at = data.rfind(b"</robot>")
    macros = [b'<xacro:macro name="m0"><a/></xacro:macro>']
    for n in range(1, depth):
        call = b"<xacro:m%d/>" % (n - 1)
        macros.append(b'<xacro:macro name="m%d">%s%s</xacro:macro>' % (n, call, call))
    macros.append(b"<xacro:m%d/>" % (depth - 1))
    return data[:at] + b"".join(macros) + data[at:] if at > 0 else data


XACRO = (*TEXT, *[mutate_xml] * 12, *[change_expression] * 8, *[add_element] * 5, add_macros)
"""For ``.xacro``. Few inputs have `add_macros`, because most of these run until their limit."""
