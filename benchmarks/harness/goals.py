"""Goals of the figures, and the exit status of a benchmark."""

import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.harness.figures import show, table, write_json


@dataclass(frozen=True, slots=True)
class Goal:
    """A figure ``found`` and what is ``expected``; ``good`` is None if it was not measured."""

    what: str
    found: str
    good: bool | None
    expected: str


def _limited(
    kind: str, what: str, value: float | None, limit: float, unit: str = "", digits: str = "g"
) -> Goal:
    expected = f"{kind} {round(limit, 2)} {unit}".strip()
    if value is None:
        return Goal(what, "not measured in this run", None, expected)
    good = value <= limit if kind == "at most" else value >= limit
    return Goal(what, f"{value:{digits}} {unit}".strip(), good, expected)


# For example at_most("step p99 is", 1.2, 1.0, "ms", ".3f").
at_most, at_least = partial(_limited, "at most"), partial(_limited, "at least")


def missed(goals: Iterable[Goal]) -> list[str]:
    """One sentence for each missed goal: the figure beside what is expected."""
    wrong = [goal for goal in goals if goal.good is False]
    return [f"{each.what} {each.found}; expected {each.expected}" for each in wrong]


def finish(path: Path | None, figures: Mapping[str, Any], goals: Iterable[Goal]) -> int:
    """Show the goals, write the figures, name the missed ones on standard error; 1 with any."""
    goals = list(goals)
    labels = {True: "[green]ok[/]", False: "[bold red]MISS[/]", None: "-"}
    rows = [(labels[each.good], f"{each.what} {each.expected}", each.found) for each in goals]
    show(table("goals", ("", "goal", "measured"), rows, left=3))
    wrong = missed(goals)
    document = {**figures, "goals": [asdict(goal) for goal in goals], "failures": wrong}
    write_json(path, document)
    for sentence in wrong:
        print(sentence, file=sys.stderr)
    return 1 if wrong else 0
