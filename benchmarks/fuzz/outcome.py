"""What a parser did with one input: a value, a typed error, or a finding."""

import hashlib
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.geometry import MarginGuardError

MAX_SECONDS = 2.0
MAX_BYTES = 1 << 30
"""Limits of one input: time without waiting for a processor, and resident memory."""

MAX_LINE = 2000
"""Longest message of an error that still is one line for a person."""

VALUE, ERROR = "value", "error"
UNTYPED, LINES, UNNAMED, PRINTED = "untyped", "lines", "unnamed", "printed"
SLOW, MEMORY, CRASH = "slow", "memory", "crash"


@dataclass(frozen=True, slots=True)
class Outcome:
    """``kind`` is `VALUE`, `ERROR` or that of a finding; ``place`` tells equal findings apart."""

    kind: str
    detail: str = ""
    place: str = ""

    @property
    def signature(self) -> str:
        """Ten hexadecimal digits, the same for findings at one place."""
        return hashlib.sha256(f"{self.kind} {self.place}".encode()).hexdigest()[:10]


def observe(parse: Callable[[Path], Any], path: Path, *, names_file: bool = True) -> Outcome:
    """Parse the file at ``path`` and judge the error, if there is one."""
    try:
        parse(path)
    except MarginGuardError as error:
        return _judged(error, path, names_file=names_file)
    except Exception as error:  # every other type is a finding
        return Outcome(UNTYPED, traceback.format_exc(limit=-12), _place(error))
    return Outcome(VALUE)


def _judged(error: MarginGuardError, path: Path, *, names_file: bool) -> Outcome:
    line = str(error)
    if len(line.splitlines()) != 1 or not line.isprintable() or len(line) > MAX_LINE:
        return Outcome(LINES, f"{len(line)} characters: {line[:3000]!r}", _place(error))
    if names_file and not (path.name in line or path.parent.name in line):
        return Outcome(UNNAMED, line, _place(error))
    return Outcome(ERROR)


def _place(error: BaseException) -> str:
    """Type of the error, and the innermost line of code."""
    frames = traceback.extract_tb(error.__traceback__)
    last = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    own = [frame for frame in frames if "/app/" in frame.filename]
    first = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""
    return f"{type(error).__name__} {first} {last}"
