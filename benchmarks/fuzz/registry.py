"""All fuzzed parsers by name."""

from importlib import import_module

from benchmarks.fuzz.parser import FuzzedParser

MODULES = (
    "benchmarks.fuzz.parsers.text_files",
    "benchmarks.fuzz.parsers.meshes",
    "benchmarks.fuzz.parsers.robots",
    "benchmarks.fuzz.parsers.recordings",
    "benchmarks.fuzz.parsers.images",
    "benchmarks.fuzz.parsers.messages",
)
"""Modules with a tuple ``PARSERS``."""


def all_parsers() -> dict[str, str]:
    """Return the address, ``module:name``, of every registered parser, by name."""
    found: dict[str, str] = {}
    for module in MODULES:
        for parser in import_module(module).PARSERS:
            if parser.name in found:
                raise ValueError(f"two fuzzed parsers are named {parser.name!r}")
            found[parser.name] = f"{module}:{parser.name}"
    return found


def parser_at(address: str) -> FuzzedParser:
    """Return the parser at ``module:name``; imports no other module of parsers."""
    module, _, name = address.partition(":")
    parsers: tuple[FuzzedParser, ...] = import_module(module).PARSERS
    return next(parser for parser in parsers if parser.name == name)
