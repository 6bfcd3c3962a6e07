"""Reasons and distances as text for the page."""

from app.fixture import MarginState, Reason


def reason_text(state: MarginState, reasons: tuple[Reason, ...]) -> str:
    """Text of the worst reason for ``state``; of all faults while it is UNKNOWN.

    `Reason.LATCHED` is left out: the page shows the hold separately.
    """
    listed = [reason for reason in reasons if reason is not Reason.LATCHED]
    listed = [r for r in listed if r.is_fault] if state is MarginState.UNKNOWN else listed[:1]
    return "; ".join(reason.text for reason in listed)


def distance_text(signed_distance_mm: float | None) -> str:
    """The distance in mm with one decimal and a minus sign; a dash for None."""
    if signed_distance_mm is None:
        return "\N{EN DASH}"
    return f"{signed_distance_mm:.1f}".replace("-", "\N{MINUS SIGN}")
