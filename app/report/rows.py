"""What the report keeps of one step: plain numbers, so that a long replay stays small in memory."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Self

from app.fixture import MarginState, Reason
from app.geometry import NS_PER_S
from app.report.errors import ReportError

if TYPE_CHECKING:
    from app.session import StepResult


@dataclass(frozen=True, slots=True)
class ReportRow:
    """One frame of the replay.

    ``signed_distance_mm`` and ``lower_bound_mm`` are None where the step could not evaluate them;
    ``tip_mm`` is the tool's tip in tumour coordinates, None where it is not known;
    ``stop_total_mm`` and ``warn_total_mm`` are the margins that the step applied, None where it
    applied none. A number that is not finite raises `ReportError`: an unknown is None, never NaN.
    """

    stamp_ns: int
    state: MarginState
    reasons: tuple[str, ...] = ()
    signed_distance_mm: float | None = None
    lower_bound_mm: float | None = None
    tip_mm: tuple[float, float, float] | None = None
    stop_total_mm: float | None = None
    warn_total_mm: float | None = None

    def __post_init__(self) -> None:
        numbers = (
            self.signed_distance_mm,
            self.lower_bound_mm,
            self.stop_total_mm,
            self.warn_total_mm,
            *(self.tip_mm or ()),
        )
        for number in numbers:
            if number is not None and not math.isfinite(number):
                raise ReportError(
                    f"row at {self.stamp_ns} ns holds {number}: finite numbers or None wanted"
                )

    @classmethod
    def from_step(cls, step: "StepResult") -> Self:
        """The row of one step of the session."""
        decision = step.decision
        proximity, margin = decision.proximity, decision.margin
        tip = step.tumor_from_tip
        return cls(
            stamp_ns=step.frame.stamp.ns,
            state=decision.state,
            reasons=_words(decision.reasons),
            signed_distance_mm=_finite(proximity.signed_distance_mm) if proximity else None,
            lower_bound_mm=_finite(proximity.lower_bound_mm) if proximity else None,
            tip_mm=None if tip is None else _point(tip.translation_mm.tolist()),
            stop_total_mm=_finite(margin.total_mm) if margin else None,
            warn_total_mm=_finite(margin.warn_total_mm) if margin else None,
        )

    @property
    def inside(self) -> bool:
        """Whether this frame was evaluated and found the tool in the tumour."""
        return self.signed_distance_mm is not None and self.signed_distance_mm < 0.0


def seconds_since(first_ns: int, stamp_ns: int) -> float:
    """Seconds between two stamps of one clock."""
    return (stamp_ns - first_ns) / NS_PER_S


@lru_cache(maxsize=256)  # a replay has few sets of reasons: its rows share their words
def _words(reasons: tuple[Reason, ...]) -> tuple[str, ...]:
    return tuple(str(reason) for reason in reasons)


def _finite(number: float) -> float | None:
    # A proximity that is not finite makes the state UNKNOWN: its row then has no distance.
    return float(number) if math.isfinite(number) else None


def _point(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return (x, y, z)
