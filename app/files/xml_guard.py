"""XML of unknown origin: read with a size bound and without a document type.

Entity bombs and external entities need a document type. None of the formats read here uses one, so
any is refused before its declarations are read.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat

from app.files.bounded_io import read_bounded
from app.geometry import InputError, MarginGuardError

if TYPE_CHECKING:
    from lxml import etree

MAX_XML_BYTES = 64 * 1024 * 1024
"""COLLADA files of real robots reach tens of MB."""

MAX_DEPTH = 200
MAX_ELEMENTS = 300_000
"""Limits for the nesting and the number of elements. libxml2's own limit of depth is 256."""

_LARGE_BYTES = 8 * 1024 * 1024
"""Beyond this size libxml2 needs ``huge_tree``."""


class _DoctypeFoundError(Exception):
    pass


class _TooLargeError(Exception):
    """The document has too many elements, or too deep ones."""


def read_xml(path: Path, error: type[MarginGuardError], *, max_bytes: int = MAX_XML_BYTES) -> bytes:
    """Read a well-formed XML file without document type; raise ``error`` for any other."""
    data = read_bounded(path, max_bytes, error)
    check_xml(data, path, error)
    return data


def parse_xml(data: bytes, place: Path | str, error: type[MarginGuardError]) -> "etree._Element":
    """Parse bytes that passed `check_xml` to the root element; ``place`` is for messages."""
    from lxml import etree  # slow to load

    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True,
        remove_pis=True, huge_tree=len(data) > _LARGE_BYTES,
    )  # fmt: skip
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        raise error(f"{place} is not well-formed: {problem.msg}; expected XML") from problem


def check_xml(data: bytes, place: Path | str, error: type[MarginGuardError]) -> None:
    """Raise ``error`` for bytes that are not well-formed XML, or have a document type."""
    walk_xml(data, place, error=error)


def walk_xml(
    data: bytes,
    place: Path | str,
    *,
    start: Callable[[str, dict[str, str]], None] | None = None,
    end: Callable[[str], None] | None = None,
    error: type[MarginGuardError] = InputError,
) -> None:
    """Call ``start`` with tag and attributes, and ``end`` with the tag, for each element in order.

    Raises ``error`` for bytes that are not well-formed XML, have a document type, or have more than
    `MAX_ELEMENTS` elements or `MAX_DEPTH` levels. expat stops at a document type before any entity
    is declared.
    """
    depth = count = 0

    def refuse(*_: object) -> None:
        raise _DoctypeFoundError

    def enter(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth += 1
        count += 1
        if depth > MAX_DEPTH:
            raise _TooLargeError(f"elements nested deeper than {MAX_DEPTH} levels")
        if count > MAX_ELEMENTS:
            raise _TooLargeError(f"more than {MAX_ELEMENTS} elements")
        if start is not None:
            start(name, attributes)

    def leave(name: str) -> None:
        nonlocal depth
        depth -= 1
        if end is not None:
            end(name)

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = enter
    parser.EndElementHandler = leave
    try:
        parser.Parse(data, True)
    except _DoctypeFoundError as problem:
        raise error(
            f"{place} has a document type (DOCTYPE) in line {parser.CurrentLineNumber}; "
            "expected none, because entities can exhaust memory or read other files"
        ) from problem
    except _TooLargeError as problem:
        line = parser.CurrentLineNumber
        raise error(f"{place} line {line}: {problem}; expected a smaller document") from problem
    except (expat.ExpatError, ValueError, LookupError) as problem:
        raise error(f"{place} is not well-formed: {problem}; expected XML") from problem
