"""Counts of the reasons of a replay."""

from collections.abc import Sequence
from dataclasses import dataclass

from app.report.rows import ReportRow, seconds_since


@dataclass(frozen=True, slots=True)
class ReasonCount:
    """``reason`` was among the reasons of ``frames`` frames, first at ``first_s`` seconds."""

    reason: str
    frames: int
    first_s: float


def count_reasons(rows: Sequence[ReportRow]) -> tuple[ReasonCount, ...]:
    """Count every reason that occurs, the most frequent first."""
    counts: dict[str, int] = {}
    first_s: dict[str, float] = {}
    for row in rows:
        for reason in row.reasons:
            counts[reason] = counts.get(reason, 0) + 1
            first_s.setdefault(reason, seconds_since(rows[0].stamp_ns, row.stamp_ns))
    ordered = sorted(counts, key=lambda reason: (-counts[reason], reason))
    return tuple(ReasonCount(reason, counts[reason], first_s[reason]) for reason in ordered)
