"""Reasons and distances as text for the page."""

from app.fixture import MarginState, Reason

REASON_TEXTS = {
    Reason.MESH_MISSING: "the tumour or the tool has no shape",
    Reason.MESH_NOT_CLOSED: "the shape of tumour or tool is not closed",
    Reason.REGISTRATION_MISSING: "the robot is not registered",
    Reason.REGISTRATION_REFUSED: "the registration was not accepted",
    Reason.REGISTRATION_DRIFT: "the tool is not where the robot's joints put it",
    Reason.CLOCK_JUMPED_BACK: "the tracker's clock jumped back",
    Reason.FUTURE_STAMP: "a pose is stamped in the future",
    Reason.NOT_FINITE: "a pose is not a number",
    Reason.NOT_RIGID: "a pose is not a rigid motion",
    Reason.INVALID: "the tracker calls a pose invalid",
    Reason.MISSING: "tool or tumour is not tracked",
    Reason.STALE: "the poses are too old",
    Reason.FROZEN: "a pose repeats itself: its source is stuck",
    Reason.STARTING: "waiting for the first full measurement",
    Reason.RECOVERING: "tracking is back, waiting until it is steady",
    Reason.CONTACT: "the surfaces of tool and tumour meet",
    Reason.INSIDE: "the tool is in the tumour",
    Reason.STOP_DISTANCE: "nearer than the stop margin",
    Reason.WARNING_DISTANCE: "nearer than the warning distance",
    Reason.RELEASING: "better again, waiting until it is steady",
    Reason.LATCHED: "on hold after a fault until re-armed",
    Reason.CLEAR: "the margin is kept",
}


def reason_text(state: MarginState, reasons: tuple[Reason, ...]) -> str:
    """Text of the worst reason for ``state``; of all faults while it is UNKNOWN.

    `Reason.LATCHED` is left out: the page shows the hold separately.
    """
    listed = [reason for reason in reasons if reason is not Reason.LATCHED]
    listed = [r for r in listed if r.is_fault] if state is MarginState.UNKNOWN else listed[:1]
    return "; ".join(REASON_TEXTS[reason] for reason in listed)


def distance_text(signed_distance_mm: float | None) -> str:
    """The distance in mm with one decimal and a minus sign; a dash for None."""
    if signed_distance_mm is None:
        return "\N{EN DASH}"
    return f"{signed_distance_mm:.1f}".replace("-", "\N{MINUS SIGN}")
