"""XML from strangers: read with a size bound, and never with a document type.

A document type is what entity bombs and external entities need, and neither URDF nor COLLADA uses
one, so any is refused before its declarations are read.
"""

from pathlib import Path
from xml.parsers import expat

from lxml import etree

from app.geometry import MarginGuardError

MAX_XML_BYTES = 256 * 1024 * 1024
"""COLLADA files of real robots reach tens of MB."""


class _DoctypeFoundError(Exception):
    pass


def read_xml(path: Path, error: type[MarginGuardError], *, max_bytes: int = MAX_XML_BYTES) -> bytes:
    """The bytes of a well-formed XML file without document type; raise ``error`` otherwise."""
    data = read_file(path, error, max_bytes=max_bytes)
    check_xml(data, path, error)
    return data


def read_file(path: Path, error: type[MarginGuardError], *, max_bytes: int) -> bytes:
    """The bytes of a file of at most ``max_bytes``; raise ``error`` otherwise."""
    try:
        with path.open("rb") as file:
            data = file.read(max_bytes + 1)
    except OSError as problem:
        raise error(f"{path} cannot be read: {problem.strerror or problem}") from problem
    if len(data) > max_bytes:
        raise error(f"{path} has more than the {max_bytes} bytes that are allowed")
    return data


def parse_xml(data: bytes, path: Path | str, error: type[MarginGuardError]) -> etree._Element:
    """The root element of bytes that were checked; ``path`` is for the message."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True,
        remove_pis=True, huge_tree=len(data) > 8 * 1024 * 1024,
    )  # fmt: skip
    try:
        return etree.fromstring(data, parser)
    except etree.XMLSyntaxError as problem:
        raise error(f"{path} is not well-formed XML: {problem.msg}") from problem


def check_xml(data: bytes, path: Path | str, error: type[MarginGuardError]) -> None:
    """Raise ``error`` for bytes that are not well-formed XML, or have a document type.

    expat walks through them: it stops at a document type, before any entity is declared.
    """

    def refuse(*_: object) -> None:
        raise _DoctypeFoundError

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(data, True)
    except _DoctypeFoundError as problem:
        raise error(
            f"{path} has a document type (DOCTYPE) in line {parser.CurrentLineNumber}: "
            "none is allowed, because entities can exhaust memory or read other files"
        ) from problem
    except (expat.ExpatError, ValueError, LookupError) as problem:
        raise error(f"{path} is not well-formed XML: {problem}") from problem
