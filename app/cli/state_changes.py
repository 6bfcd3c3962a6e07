"""Select the steps of a live session that are printed on the terminal."""

from collections.abc import Iterable, Iterator

from app.fixture import FixtureDecision, Reason
from app.geometry import NS_PER_S
from app.session import StepResult

MIN_DURATION_NS = 2 * NS_PER_S
"""Better reasons are printed after this duration, by the stamps of the frames."""

_RANK = {reason: rank for rank, reason in enumerate(Reason)}


def state_changes(steps: Iterable[StepResult]) -> Iterator[StepResult]:
    """Yield steps with another state or hold, or worse reasons, at once; better reasons late.

    Close to a threshold the reasons change at every other frame while state and hold stay. The
    last printed line is therefore correct, or too severe for at most `MIN_DURATION_NS`.
    """
    printed: FixtureDecision | None = None
    better_since_ns: int | None = None
    for step in steps:
        decision, now_ns = step.decision, step.frame.stamp.ns
        if printed is not None and (decision.state, decision.hold) == (printed.state, printed.hold):
            severity, severity_printed = _severity(decision), _severity(printed)
            if severity == severity_printed:
                better_since_ns = None
                continue
            if severity < severity_printed:
                if better_since_ns is None or now_ns < better_since_ns:  # the clock jumped back
                    better_since_ns = now_ns
                if now_ns - better_since_ns < MIN_DURATION_NS:
                    continue
        printed, better_since_ns = decision, None
        yield step


def _severity(decision: FixtureDecision) -> tuple[int, ...]:
    """Larger for worse reasons: compares the worst reason first, then the number of reasons."""
    return tuple(-_RANK[reason] for reason in decision.reasons)
