"""Runs ``marginguard`` in this process: exit status, and what it printed."""

import io
import json
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.cli.main import main
from app.report import ReplayLog
from app.report.rows import margin_csv
from app.runtime import ReplayRun, prepare_case


@dataclass(frozen=True, slots=True)
class Printed:
    """Text that a command wrote to its standard streams."""

    out: str
    err: str


class TerminalDouble(io.StringIO):
    """Test double of a terminal."""

    def isatty(self) -> bool:
        return True


def run(*words: object, status: int = 0) -> Printed:
    """Run a command that has to end with ``status``."""
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True) for _ in range(2)]
    with redirect_stdout(streams[0]), redirect_stderr(streams[1]):
        try:
            found: object = main([str(word) for word in words])
        except SystemExit as stop:  # an error of usage, or the end of --help
            found = stop.code
    printed = Printed(*(stream.buffer.getvalue().decode() for stream in streams))  # type: ignore[attr-defined]
    assert found == status, (found, printed)
    return printed


def run_json(*words: object, status: int = 0) -> Any:
    """The JSON document that a command prints with ``--json``."""
    return json.loads(run(*words, "--json", status=status).out)


def refused(*words: object) -> str:
    """The one line with which a command refuses bad input; nothing else is printed."""
    printed = run(*words, status=2)
    (line,) = printed.err.splitlines()
    assert printed.out == ""
    return line


def margin_table(case: Path, rate: float | None = None, tool: str | None = None) -> bytes:
    """The bytes of ``margin.csv``, without the other files of a report, which take seconds."""
    log, prepared = ReplayLog(), prepare_case(case, tool=tool)
    for _ in ReplayRun(prepared, clock_ns=time.monotonic_ns, rate=rate, outputs=[log]).steps():
        pass
    others = {name: each.rows for name, each in log.structures.items()}
    return margin_csv(log.rows, others).encode()
