"""Outcome of a parser for one input: a value, a typed error, or a finding."""

import traceback
from dataclasses import dataclass
from pathlib import Path

from app.geometry import MarginGuardError
from tests.fuzz.parser import FuzzedParser

MAX_LINE = 2000
"""Longest message of an error that still is one line for a person."""

VALUE, ERROR = "value", "error"
UNTYPED, LINES, UNNAMED, PRINTED = "untyped", "lines", "unnamed", "printed"
SLOW, MEMORY, CRASH = "slow", "memory", "crash"


@dataclass(frozen=True, slots=True)
class Outcome:
    """``kind`` is `VALUE`, `ERROR` or that of a finding."""

    kind: str
    detail: str = ""

    @property
    def is_finding(self) -> bool:
        """True unless the result is a value or a typed error of one line."""
        return self.kind not in (VALUE, ERROR)


def observe(parser: FuzzedParser, path: Path) -> Outcome:
    """Parse the file at ``path``; every error but a typed one of one line is a finding."""
    try:
        parser.parse(path)
    except MarginGuardError as error:
        line = str(error)
        if len(line.splitlines()) != 1 or not line.isprintable() or len(line) > MAX_LINE:
            return Outcome(LINES, f"{len(line)} characters: {line[:3000]!r}")
        if parser.names_file and not (path.name in line or path.parent.name in line):
            return Outcome(UNNAMED, line)
        return Outcome(ERROR)
    except Exception:  # every other type is a finding
        return Outcome(UNTYPED, traceback.format_exc(limit=-12))
    return Outcome(VALUE)
