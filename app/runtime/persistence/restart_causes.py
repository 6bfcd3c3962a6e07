"""Why a run begins on hold, from the record of the run before it."""

from datetime import datetime

from app.geometry import NS_PER_S
from app.runtime.persistence.run_record import RunRecord

RESTARTED = "guard restarted"
"""Begins the first cause of a hold that an earlier run has left."""

_MAX_EARLIER = 7


def causes_of_record(record: RunRecord, alive_ns: int | None) -> tuple[str, ...]:
    """Causes of the hold after the run of ``record``; empty if the next run may start without.

    ``alive_ns``: system time at which that run was last seen alive, None if it is not known.
    """
    if record.allows_start:
        return ()
    hold = record.hold
    since = "" if hold is None else f", hold since {local_time(hold.since_ns)}"
    if record.ended:
        how = f"ended on hold at {local_time(record.written_ns)}"
    else:
        last_ns = max(record.written_ns, alive_ns or 0)
        how = f"ended without a stop at about {local_time(last_ns)}"
    earlier = () if hold is None else hold.causes
    kept = [cause for cause in earlier if not cause.startswith(RESTARTED)]
    first = f"{RESTARTED}: the last run (process {record.pid}) {how}{since}"
    return (first, *kept[:_MAX_EARLIER])


def causes_of_damage(problem: object) -> tuple[str, ...]:
    """Causes of the hold if the record of the last run cannot be used."""
    return (f"{RESTARTED}: how the last run ended is not known: {problem}",)


def local_time(ns: int) -> str:
    """Local time in ISO 8601 with seconds and offset; the number where it is no time of day."""
    try:
        return datetime.fromtimestamp(ns // NS_PER_S).astimezone().isoformat(timespec="seconds")
    except (OverflowError, OSError, ValueError):
        return f"{ns} ns"
