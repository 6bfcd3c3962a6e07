"""Figures of a run: percentiles, goals with the exit status, one table and one JSON file."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, 99th percentile and maximum, in ms."""

    p50_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, ms: Any) -> "Spread":
        """Spread of durations (n,) in ms."""
        return cls(*percentiles(ms, 50, 99, 100))

    @property
    def cells(self) -> tuple[str, str, str]:
        return f"{self.p50_ms:.3f}", f"{self.p99_ms:.3f}", f"{self.max_ms:.3f}"


def in_turns(peers: Sequence[Peer], rounds: int, what: str) -> Iterator[Peer]:
    """Each of ``peers`` once per round, so that other work on the machine affects all of them."""
    return with_progress(list(peers) * rounds, what)


@dataclass(frozen=True, slots=True)
class Goal:
    """A figure ``found`` and what is ``expected``; ``good`` is None if it was not measured."""

    what: str
    found: str
    good: bool | None
    expected: str = ""

    @property
    def sentence(self) -> str:
        """The figure beside the goal."""
        return f"{self.what} {self.found}; expected {self.expected}"


def at_most(
    what: str, value: float | None, limit: float, unit: str = "", digits: str = "g"
) -> Goal:
    """Goal of an upper limit, for example ``at_most("step p99 is", 1.2, 1.0, "ms", ".3f")``."""
    return _limited(
        what, value, f"at most {round(limit, 2)} {unit}".strip(), unit, digits, -1, limit
    )


def at_least(
    what: str, value: float | None, limit: float, unit: str = "", digits: str = "g"
) -> Goal:
    """Goal of a lower limit."""
    return _limited(
        what, value, f"at least {round(limit, 2)} {unit}".strip(), unit, digits, 1, limit
    )


def _limited(
    what: str, value: float | None, expected: str, unit: str, digits: str, sign: int, limit: float
) -> Goal:
    if value is None:
        return Goal(what, "not measured in this run", None, expected)
    return Goal(what, f"{value:{digits}} {unit}".strip(), sign * value >= sign * limit, expected)


def missed(goals: Iterable[Goal]) -> list[str]:
    """Missed goals, one sentence each."""
    return [goal.sentence for goal in goals if goal.good is False]


def goals_table(goals: Iterable[Goal], title: str = "goals") -> Table:
    """One row per goal, with the measured value and whether it is met."""
    labels = {True: "[green]ok[/]", False: "[bold red]MISS[/]", None: "-"}
    rows = [(labels[goal.good], goal.what, goal.found) for goal in goals]
    return table(title, ("", "goal", "measured"), rows, left=3)


def table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[object]], *, left: int = 1
) -> Table:
    """Table whose first ``left`` columns are aligned to the left, all others to the right.

    Numbers have three digits after the point, None is empty.
    """
    made = Table(title=title, title_justify="left")
    for number, heading in enumerate(headings):
        made.add_column(
            heading, justify="left" if number < left else "right", no_wrap=number >= left
        )
    for row in rows:
        made.add_row(*map(_cell, row))
    return made


def _cell(value: object) -> str:
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
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
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


def finish(path: Path | None, figures: Mapping[str, Any], wrong: Sequence[str]) -> int:
    """Write the figures, print the missed goals on standard error; the exit status: 1 with any."""
    write_json(path, {**figures, "failures": list(wrong)})
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0
