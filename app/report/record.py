"""Input of a report: the results of a replay."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from app.case import Expected
from app.fixture import MarginParameters
from app.registration import RegistrationResult
from app.report.rows import ReportRow
from app.session import StepResult


@dataclass(slots=True)
class ReplayLog:
    """Collects the steps of a replay while it runs.

    Keeps a `ReportRow` of every step, and the `StepResult` of the deepest one for its picture.
    """

    rows: list[ReportRow] = field(default_factory=list)
    durations_ns: list[int] = field(default_factory=list)
    deepest: StepResult | None = None
    _deepest_mm: float | None = None

    def add(self, step: StepResult, duration_ns: int) -> None:
        """Add ``step``, which took ``duration_ns`` to compute."""
        row = ReportRow.from_step(step)
        self.rows.append(row)
        self.durations_ns.append(duration_ns)
        distance = row.signed_distance_mm
        if distance is not None and (self._deepest_mm is None or distance < self._deepest_mm):
            self._deepest_mm, self.deepest = distance, step


@dataclass(frozen=True, slots=True, eq=False)
class ReplayRecord:
    """All input of a report.

    ``provenance`` is the origin that the case states; ``notes`` are remarks of the reader (a
    truncated file, skipped samples). ``registration`` is None for a case without a robot,
    ``expected`` is None for a case without expected results.
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
