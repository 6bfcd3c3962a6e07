"""Figures of a run: percentiles, tables and one JSON file."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table

from app.cli.progress import with_progress

Peer = TypeVar("Peer")
_PEERS = ("numpy", "numba", "rosbags", "mujoco", "coal", "python-fcl", "vtk", "slicer-core")


def percentiles(values: Any, *percents: float) -> list[float]:
    """Percentiles of ``values`` (n,) as plain numbers; 100 is the maximum."""
    return [float(each) for each in np.percentile(values, percents)]


def spread(ms: Any) -> dict[str, float]:
    """Median, 99th percentile and maximum of durations (n,) in ms."""
    p50, p99, longest = percentiles(ms, 50, 99, 100)
    return {"p50_ms": p50, "p99_ms": p99, "max_ms": longest}


def in_turns(peers: Sequence[Peer], rounds: int, what: str) -> Iterator[Peer]:
    """Each of ``peers`` once per round, so that other work on the machine affects all of them."""
    return with_progress(list(peers) * rounds, what)


def table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[object]], *, left: int = 1
) -> Table:
    """Table whose first ``left`` columns are aligned to the left, all others to the right.

    Numbers have three digits after the point, None is empty, several values share a cell.
    """
    made = Table(title=title, title_justify="left")
    for number, heading in enumerate(headings):
        made.add_column(
            heading, justify="left" if number < left else "right", no_wrap=number >= left
        )
    for row in rows:
        made.add_row(*map(_cell, row))
    return made


def columns_table(
    title: str, rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str], *, left: int = 1
) -> Table:
    """One row for each of ``rows``; ``columns`` are their headings and keys."""
    return table(
        title, list(columns), ([row[key] for key in columns.values()] for row in rows), left=left
    )


def figures_table(found: Mapping[str, Any]) -> Table:
    """One row for each figure; lists are in the file alone."""
    rows = [(name, value) for name, value in found.items() if not isinstance(value, list)]
    return table(f"load {load()}", ("figure", "measured"), rows, left=2)


def _cell(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_cell(each)}" for name, each in value.items())
    if isinstance(value, list):
        return "; ".join(map(_cell, value))
    if value is None:
        return ""
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def show(*parts: Any, width: int = 150) -> None:
    """Print tables and texts; ``width`` is that of a pipe or file."""
    console = Console(width=None if sys.stdout.isatty() else width)
    for part in parts:
        console.print(part, highlight=False)


def load(average: int = 0) -> float:
    """Load average of the machine over 1, 5 or 15 minutes (0, 1, 2)."""
    return round(os.getloadavg()[average], 2)


def machine() -> dict[str, Any]:
    """The machine, the time and the versions that figures belong to."""
    versions = {"python": platform.python_version()}
    for name in ("marginguard", *_PEERS):
        with suppress(PackageNotFoundError):
            versions[name] = version(name)
    root = Path(__file__).resolve().parents[2]
    command = ["git", "-C", str(root), "rev-parse", "--short", "HEAD"]
    try:
        commit = subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
    except OSError:
        commit = ""
    return {
        "cores": os.cpu_count(),
        "kind": platform.machine(),
        "memory_gb": round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9),
        "load": load(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions,
        "commit": commit or None,
    }


def write_json(path: Path | None, figures: Mapping[str, Any]) -> None:
    """Write ``figures`` and the `machine` to ``path``, if it is given."""
    if path is not None:
        path.write_text(json.dumps({"machine": machine(), **figures}, indent=1) + "\n")
