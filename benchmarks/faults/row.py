"""A row of the fault matrix, and the result of one trial."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from benchmarks.faults.bench import Bench
from benchmarks.faults.records import Verdict

DROPOUT = frozenset({"stale", "missing", "latched", "starting", "recovering", "clear", "expired"})
"""Reasons of a hold that a busy machine causes, too."""


SINGLE_SOURCE = "single source"
"""Residual risk of a session that has no second measurement; it must be flagged as such."""


class Variant(StrEnum):
    """Which sources the session has."""

    LIVE_JOINTS = "live joints"
    SILENT_JOINTS = "silent joints"
    NO_ROBOT = "no robot"


@dataclass(frozen=True, slots=True)
class Trial:
    """``verdict`` of one fault, with the error of the pose when it was detected, and a note."""

    verdict: Verdict
    error_mm: float | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Row:
    """One fault under one variant.

    ``second_source`` names what can contradict the fault; empty: nothing can, and ``residual``
    names the risk that remains. ``bound`` is the declared limit as text. ``restarts`` is true if
    the guard cannot be used afterwards; ``trials`` overrides the number of trials.
    """

    name: str
    variant: Variant
    run: Callable[[Bench], Trial]
    second_source: str
    bound: str
    residual: str = ""
    restarts: bool = False
    trials: int | None = None

    @property
    def label(self) -> str:
        """Unique name: that of the fault and the variant."""
        return f"{self.name} ({self.variant})"
