"""The steps of a live session that are worth a line to a person who watches."""

from collections.abc import Iterable, Iterator

from app.fixture import FixtureDecision, Reason
from app.geometry import NS_PER_S
from app.session import StepResult

LASTED_NS = 2 * NS_PER_S
"""For so long, by the frames' stamps, have reasons to be better than those that were told last."""

_RANK = {reason: rank for rank, reason in enumerate(Reason)}


def news(steps: Iterable[StepResult]) -> Iterator[StepResult]:
    """Those with another state or hold, or worse reasons, at once; better reasons late.

    Close to a bound the reasons change at every other frame while state and hold stay. So what
    was told last holds, or is worse than what has held since, for `LASTED_NS` at most.
    """
    told: FixtureDecision | None = None
    better_since_ns: int | None = None
    for step in steps:
        decision, now_ns = step.decision, step.frame.stamp.ns
        if told is not None and (decision.state, decision.hold) == (told.state, told.hold):
            badness, badness_told = _badness(decision), _badness(told)
            if badness == badness_told:
                better_since_ns = None
                continue
            if badness < badness_told:
                if better_since_ns is None or now_ns < better_since_ns:  # the clock went back
                    better_since_ns = now_ns
                if now_ns - better_since_ns < LASTED_NS:
                    continue
        told, better_since_ns = decision, None
        yield step


def _badness(decision: FixtureDecision) -> tuple[int, ...]:
    """Larger for worse reasons: the worst of them first, then for more of them."""
    return tuple(-_RANK[reason] for reason in decision.reasons)
