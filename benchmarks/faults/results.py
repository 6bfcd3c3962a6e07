"""Results of a row over its trials, and the table of all rows."""

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from rich.table import Table

from benchmarks.faults.row import SINGLE_SOURCE, Row, Trial

SAFE, UNSAFE, RESIDUAL, UNMEASURED = "safe", "UNSAFE", "residual risk", "not measured"
UNFLAGGED = "NOT FLAGGED"
"""A single source that the constraint does not name as such."""


@dataclass(slots=True)
class RowResult:
    """Trials of ``row``; ``unmeasured`` are the reasons of trials that gave no result.

    ``held_before`` is true if the session was on hold before the fault could begin, for the reason
    that a source is missing.
    """

    row: Row
    trials: list[Trial] = field(default_factory=list)
    unmeasured: list[str] = field(default_factory=list)
    held_before: str = ""

    @property
    def to_safe_ms(self) -> list[float]:
        """Times to safe of the trials that became safe, in ms."""
        times = [trial.verdict.to_safe_ms for trial in self.trials]
        return [time for time in times if time is not None]

    @property
    def never_safe(self) -> int:
        """Number of trials that did not become safe."""
        return len(self.trials) - len(self.to_safe_ms)

    @property
    def late(self) -> int:
        """Number of late permissive constraints and answers, over all trials."""
        return sum(
            trial.verdict.late_constraints + trial.verdict.late_twists for trial in self.trials
        )

    @property
    def outcome(self) -> str:
        """One of the five outcomes. A row without a second source is a named residual risk."""
        if self.held_before:
            return SAFE
        if not self.trials:
            return UNMEASURED
        if self.late == 0 and self.never_safe == 0:
            return SAFE
        if self.row.second_source:
            return UNSAFE
        flagged = all(trial.verdict.single_source for trial in self.trials)
        return RESIDUAL if flagged or self.row.residual != SINGLE_SOURCE else UNFLAGGED

    @property
    def passed(self) -> bool:
        """False if the row must be safe and is not, or could not be measured."""
        return self.outcome in (SAFE, RESIDUAL)

    def document(self) -> dict[str, Any]:
        """All figures, for JSON."""
        errors = [trial.error_mm for trial in self.trials if trial.error_mm is not None]
        times = self.to_safe_ms
        sources = {trial.verdict.single_source for trial in self.trials}
        return {
            "fault": self.row.name,
            "variant": str(self.row.variant),
            "second_source": self.row.second_source or None,
            "residual": self.row.residual or None,
            "bound": self.row.bound,
            "outcome": self.outcome,
            "trials": len(self.trials),
            "unmeasured": self.unmeasured,
            "held_before": self.held_before,
            "never_safe": self.never_safe,
            "to_safe_ms": {
                "median": statistics.median(times) if times else None,
                "worst": max(times, default=None),
            },
            "over_limit_ms": max((t.verdict.over_limit_ms for t in self.trials), default=None),
            "late_constraints": sum(trial.verdict.late_constraints for trial in self.trials),
            "late_twists": sum(trial.verdict.late_twists for trial in self.trials),
            "max_approach_mm_s": max(
                (t.verdict.max_approach_mm_s for t in self.trials), default=None
            ),
            "error_mm": max(errors, default=None),
            "single_source": None if sources <= {None} else True in sources,
            "reasons": reasons(self.trials),
            "notes": [trial.note for trial in self.trials if trial.note],
            "verdicts": [asdict(trial.verdict) for trial in self.trials],
        }


def reasons(trials: Sequence[Trial]) -> str:
    """The reasons of the hold in most trials."""
    found = Counter(", ".join(trial.verdict.reasons) for trial in trials if trial.verdict.reasons)
    return found.most_common(1)[0][0] if found else ""


def results_table(results: Iterable[RowResult], title: str) -> Table:
    """One line per row."""
    table = Table(title=title, title_justify="left")
    table.add_column("fault")
    table.add_column("sources")
    for name in ("trials", "to safe ms", "over ms", "late", "mm/s", "error mm"):
        table.add_column(name, justify="right")
    table.add_column("reasons; notes")
    table.add_column("second source")
    table.add_column("outcome")
    for result in results:
        table.add_row(*_cells(result.document()))
    return table


def _cells(row: dict[str, Any]) -> list[str]:
    time = row["to_safe_ms"]
    if row["held_before"]:
        safe = "before"
    elif row["never_safe"]:
        safe = f"never ({row['never_safe']})"
    elif time["median"] is None:
        safe = "-"
    else:
        safe = f"{time['median']:.0f} / {time['worst']:.0f}"
    measured = f"{row['trials']}/{row['trials'] + len(row['unmeasured'])}"
    note = row["notes"][-1] if row["notes"] else ""
    why = row["unmeasured"][-1] if row["unmeasured"] and not row["trials"] else ""
    texts = (row["held_before"], row["reasons"], note, why)
    source = row["second_source"] or f"none: {row['residual']}"
    if row["single_source"] is not None:
        source += f", single_source {str(row['single_source']).lower()}"
    return [
        row["fault"],
        row["variant"],
        measured,
        safe,
        _number(row["over_limit_ms"]),
        f"{row['late_constraints']} + {row['late_twists']}",
        _number(row["max_approach_mm_s"]),
        _number(row["error_mm"], 1),
        "; ".join(text for text in texts if text),
        source,
        row["outcome"],
    ]


def _number(value: float | None, digits: int = 0) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
