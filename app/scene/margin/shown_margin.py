"""The margin that the scene shows: UNKNOWN for data that are old, from the future or not finite."""

from collections.abc import Iterable
from dataclasses import dataclass

from app.fixture import Constraint, FixtureDecision, MarginState, Proximity, Reason
from app.geometry import NS_PER_S
from app.scene.frames.watchdog import TransformWatchdog

_MAX_REASONS = 3


@dataclass(frozen=True, slots=True, eq=False)
class ShownMargin:
    """The state that colours the scene, and the text of its banner.

    ``proximity`` is None while the state is UNKNOWN. ``constraint`` is None unless it is current.
    """

    state: MarginState
    text: str
    proximity: Proximity | None = None
    constraint: Constraint | None = None


def shown_margin(
    decision: FixtureDecision | None, watchdog: TransformWatchdog | None, now_ns: int | None
) -> ShownMargin:
    """The margin to show at ``now_ns``; ``decision`` is None before the first one.

    Without ``watchdog`` the decision does not age.
    """
    if decision is None:
        return _unknown(age_text(None))
    is_known = decision.state is not MarginState.UNKNOWN
    constraint = decision.constraint if decision.constraint_is_current else None
    if watchdog is not None and now_ns is not None:
        stamp_ns = None if decision.stamp is None else decision.stamp.ns
        if not watchdog.is_fresh(stamp_ns, now_ns):
            if is_known or stamp_ns is not None:
                return _unknown(age_text(None if stamp_ns is None else now_ns - stamp_ns))
            constraint = None  # the reasons are in the decision
    if not is_known:
        text = banner(decision.state, None, decision.reasons)
        return ShownMargin(decision.state, text, constraint=constraint)
    if decision.proximity is None or not decision.proximity.is_finite:
        return _unknown("no distance")
    text = banner(decision.state, decision.proximity)
    return ShownMargin(decision.state, text, decision.proximity, constraint)


def banner(state: MarginState, proximity: Proximity | None, reasons: Iterable[Reason] = ()) -> str:
    """The state's name and description, and the signed distance in mm if it is known.

    For UNKNOWN also the faults among ``reasons``, worst first, at most `_MAX_REASONS`.
    """
    text = f"{state.name}: {state.display.description}"
    if state is MarginState.UNKNOWN:
        faults = [reason.value.replace("_", " ") for reason in reasons if reason.is_fault]
        return ", ".join([text, *faults[:_MAX_REASONS]])
    return text if proximity is None else f"{text}, {distance_text(proximity.signed_distance_mm)}"


def age_text(age_ns: int | None) -> str:
    """The reason why data of this age are not shown."""
    if age_ns is None:
        return "no data yet"
    if age_ns < 0:
        return f"data from {-age_ns / NS_PER_S:.1f} s ahead"
    return f"data {age_ns / NS_PER_S:.1f} s old"


def distance_text(signed_distance_mm: float) -> str:
    """The distance with its sign, to 0.1 mm."""
    return f"{signed_distance_mm:.1f} mm"


def _unknown(reason: str) -> ShownMargin:
    return ShownMargin(MarginState.UNKNOWN, f"{banner(MarginState.UNKNOWN, None)}, {reason}")
