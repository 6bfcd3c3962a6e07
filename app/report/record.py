"""What a replay leaves behind for its report."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.case import Expected
from app.fixture import MarginParameters
from app.registration import RegistrationResult
from app.report.rows import ReportRow
from app.session import StepResult


@dataclass(slots=True)
class ReplayLog:
    """Filled step by step while the replay runs.

    Of every step only a `ReportRow` is kept, and of the deepest one everything, for the picture.
    """

    rows: list[ReportRow] = field(default_factory=list)
    durations_ns: list[int] = field(default_factory=list)
    deepest: StepResult | None = None
    _deepest_mm: float | None = None

    def add(self, step: StepResult, duration_ns: int) -> None:
        """Keep ``step``, which took ``duration_ns`` to compute."""
        row = ReportRow.from_step(step)
        self.rows.append(row)
        self.durations_ns.append(duration_ns)
        distance = row.signed_distance_mm
        if distance is not None and (self._deepest_mm is None or distance < self._deepest_mm):
            self._deepest_mm, self.deepest = distance, step


@dataclass(frozen=True, slots=True, eq=False)
class ReplayRecord:
    """Everything that a report tells.

    ``provenance`` is the case's own account of where it comes from; ``notes`` is what the reader
    had to say (a truncated file, skipped samples); ``registration`` is None for a case without a
    robot, ``expected`` for a case that states nothing.
    """

    case: str
    provenance: Mapping[str, str]
    rows: tuple[ReportRow, ...]
    margins: MarginParameters
    registration: RegistrationResult | None = None
    expected: Expected | None = None
    durations_ns: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    tip_only: bool = False
