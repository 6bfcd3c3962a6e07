"""Mutations of xacro: hostile expressions, loops of macros and of includes."""

import re
from random import Random

from tests.fuzz.mutators.text import TEXT, nearby, splice
from tests.fuzz.mutators.tree import mutate_xml

_EXPRESSION = re.compile(rb"\$\{[^}]*\}")
_EXPRESSIONS = (
    *rb"""1/0
'a'*10**10
[0]*10**10
().__class__.__bases__[0].__subclasses__()
open('/etc/passwd')
__import__('os').system('true')
x

1 +
'
lambda: 0
(lambda f: f(f))(lambda f: f(f))
xacro.load_yaml('x')
xacro.load_yaml('/etc/passwd')
xacro.load_yaml('part.xacro')
'%0999999999d' % 1
'{:>999999999}'.format(1)
xacro.fatal('x')
xacro.warning('x')
xacro.error('x')
print_location()
xacro.message('x')
1e999
nan
max([])
sizes[99]
limits['x']
{}[1]
None
...""".split(b"\n"),
    *(b"((((" * 50, b"-" * 5000 + b"1", b"[" * 5000),
)
_LONG_EXPRESSIONS = (
    *(b"10**10**8", b"2**2**40", b"sum(range(10**10))", b"list(range(10**10))"),
    *(b"[x for x in range(10**9)]", b"' '.join(['a'] * 10**7)"),
)
"""Expressions that run until their limit; few inputs have one."""

_ELEMENTS = rb"""<xacro:include filename="arm.xacro"/>
<xacro:include filename="/etc/passwd"/>
<xacro:include filename="../*"/>
<xacro:include filename="*.xacro"/>
<xacro:include filename="/dev/zero"/>
<xacro:include filename="none" optional="true"/>
<xacro:macro name="l"><xacro:l/></xacro:macro><xacro:l/>
<xacro:macro name="l"><xacro:l/><xacro:l/></xacro:macro><xacro:l/>
<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><link name="${a}"/>
<xacro:property name="p" value="${'x' * 1000}"/><link name="${p * 100000}"/>
<xacro:call macro="${1}"/>
<xacro:element xacro:name="a b"/>
<xacro:element xacro:name="${1}"/>
<xacro:attribute name="x" value="1"/>
<xacro:attribute name="&lt;" value="&#x1;"/>
<link name="$(find none)"/>
<link name="$(eval 2**99999999)"/>
<link name="$(env HOME)"/>
<link name="$(dirname)$(arg x)$(anon a)"/>
<xacro:unknown/>
<xacro:if value="maybe"/>
<xacro:property name="d" value="1" scope="parent"/>
<xacro:property name="a.b" value="1"/>
<xacro:property name="xacro" value="1"/>
<xacro:macro name="m" params="a:=^ b:=^|1 *c **d"/><xacro:m/>""".split(b"\n")


def change_expression(data: bytes, random: Random) -> bytes:
    text = random.choice(_LONG_EXPRESSIONS if random.random() < 0.02 else _EXPRESSIONS)
    return splice(nearby(_EXPRESSION, data, random), b"${" + text + b"}")


def add_element(data: bytes, random: Random) -> bytes:
    """Insert an element behind another one."""
    at = data.index(b">\n", random.randrange(len(data) + 1)) + 1
    return data[:at] + random.choice(_ELEMENTS) + data[at:]


def add_macros(data: bytes, random: Random) -> bytes:
    """Insert macros that call each other: 2 to the power of 3 to 40 calls."""
    depth = 40 if random.random() < 0.05 else random.choice((3, 6))
    at = data.rindex(b"</robot>")
    macros = [b'<xacro:macro name="m0"><a/></xacro:macro>']
    for n in range(1, depth):
        call = b"<xacro:m%d/>" % (n - 1)
        macros.append(b'<xacro:macro name="m%d">%s%s</xacro:macro>' % (n, call, call))
    return data[:at] + b"".join(macros) + b"<xacro:m%d/>" % (depth - 1) + data[at:]


XACRO = (*TEXT, *[mutate_xml] * 12, *[change_expression] * 8, *[add_element] * 5, add_macros)
"""Few inputs have `add_macros`, because most of these run until their limit."""
