"""Rows of the fault matrix, their results over the trials, and the table of all rows."""

import statistics
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any

from benchmarks.faults.records import Verdict

DROPOUT = frozenset({"stale", "missing", "latched", "starting", "recovering", "clear", "expired"})
"""Reasons of a hold that a busy machine causes, too."""

SINGLE_SOURCE = "single source"  # risk of a session without a second measurement; must be flagged
SAFE, UNSAFE, RESIDUAL, UNMEASURED = "safe", "UNSAFE", "residual risk", "not measured"
UNFLAGGED = "NOT FLAGGED"  # a single source that the constraint does not name as such


class Variant(StrEnum):
    """Sources of the session."""

    LIVE_JOINTS = "live joints"
    SILENT_JOINTS = "silent joints"
    NO_ROBOT = "no robot"


@dataclass(frozen=True, slots=True)
class Row:
    """One fault under one variant, which ``run`` injects on a `benchmarks.faults.bench.Bench`.

    ``second_source`` names what can contradict the fault; empty: nothing can, and ``residual``
    names the risk that remains. ``bound`` is the declared limit as text. ``restarts`` is true if
    the guard cannot be used afterwards; ``trials`` overrides the number of trials.
    """

    name: str
    variant: Variant
    run: Callable[[Any], Verdict]
    second_source: str
    bound: str
    residual: str = ""
    restarts: bool = False
    trials: int | None = None

    @property
    def label(self) -> str:
        return f"{self.name} ({self.variant})"


@dataclass(slots=True)
class RowResult:
    """Trials of ``row``; ``unmeasured`` are the reasons of trials that gave no result.

    ``held_before`` is true if the session was on hold before the fault could begin, for the reason
    that a source is missing.
    """

    row: Row
    trials: list[Verdict] = field(default_factory=list)
    unmeasured: list[str] = field(default_factory=list)
    held_before: str = ""

    @property
    def to_safe_ms(self) -> list[float]:
        """Times to safe of the trials that became safe, in ms."""
        times = [trial.to_safe_ms for trial in self.trials]
        return [time for time in times if time is not None]

    @property
    def never_safe(self) -> int:
        return len(self.trials) - len(self.to_safe_ms)

    @property
    def late(self) -> int:
        return sum(trial.late_constraints + trial.late_twists for trial in self.trials)

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
        flagged = all(trial.single_source for trial in self.trials)
        return RESIDUAL if flagged or self.row.residual != SINGLE_SOURCE else UNFLAGGED

    @property
    def passed(self) -> bool:
        """False if the row must be safe and is not, or could not be measured."""
        return self.outcome in (SAFE, RESIDUAL)

    def document(self) -> dict[str, Any]:
        verdicts, times = self.trials, self.to_safe_ms
        sources = {verdict.single_source for verdict in verdicts}
        worst = {
            name: max((getattr(each, name) for each in verdicts), default=None)
            for name in ("over_limit_ms", "max_approach_mm_s")
        }
        reasons = Counter(", ".join(each.reasons) for each in verdicts if each.reasons)
        errors_mm = [each.error_mm for each in verdicts if each.error_mm is not None]
        row, median = self.row, statistics.median(times) if times else None
        return {
            "fault": row.name, "variant": str(row.variant),
            "second_source": row.second_source or None, "residual": row.residual or None,
            "bound": row.bound, "outcome": self.outcome, "trials": len(self.trials),
            "unmeasured": self.unmeasured, "held_before": self.held_before,
            "never_safe": self.never_safe,
            "to_safe_ms": {"median": median, "worst": max(times, default=None)},
            "late_constraints": sum(verdict.late_constraints for verdict in verdicts),
            "late_twists": sum(verdict.late_twists for verdict in verdicts),
            **worst,
            "error_mm": max(errors_mm, default=None),
            "single_source": None if sources <= {None} else True in sources,
            "reasons": max(reasons, key=reasons.__getitem__, default=""),
            "notes": [trial.note for trial in self.trials if trial.note],
            "verdicts": [asdict(verdict) for verdict in verdicts],
        }  # fmt: skip


COLUMNS = {
    "fault": "fault", "sources": "variant", "reasons": "reasons", "notes": "notes",
    "unmeasured": "unmeasured", "held before": "held_before", "second source": "second_source",
    "risk": "residual", "outcome": "outcome", "trials": "trials", "never safe": "never_safe",
    "to safe ms": "to_safe_ms",
    "over ms": "over_limit_ms", "late": "late_constraints", "late twists": "late_twists",
    "mm/s": "max_approach_mm_s", "error mm": "error_mm", "single source": "single_source",
}  # fmt: skip
"""Columns of the table of all rows: heading and name in a row's document."""
