"""Comparison of a replay with the expected results of its case."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from app.analysis.breaches import Breach
from app.case import (
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
)
from app.fixture import MarginState
from app.geometry import NS_PER_S
from app.registration import RegistrationResult
from app.report.rows import ReportRow, seconds_since

# Expected times are decimals in a file: rounding must not fail a tolerance that is met exactly.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Check:
    """One expectation, whether it holds, and the numbers behind the verdict."""

    name: str
    passed: bool
    detail: str

    @property
    def result(self) -> str:
        """``pass`` or ``fail``."""
        return "pass" if self.passed else "fail"


def check_expected(
    expected: Expected,
    rows: Sequence[ReportRow],
    breaches: Sequence[Breach],
    registration: RegistrationResult | None,
    stale_after_ns: int,
) -> tuple[Check, ...]:
    """Return one `Check` per entry of ``expected``, in a fixed order."""
    checks: list[Check] = []
    if expected.frames is not None:
        checks.append(_check_frames(expected.frames, len(rows)))
    if expected.registration is not None:
        checks.append(_check_registration(expected.registration, registration))
    if expected.breaches is not None:
        checks.extend(_check_breaches(expected.breaches, breaches))
    for number, dropout in enumerate(expected.dropouts, start=1):
        checks.append(_check_dropout(number, dropout, rows, stale_after_ns))
    return tuple(checks)


def _check_frames(expected: int, found: int) -> Check:
    return Check("frames", found == expected, f"{found} frames, {expected} expected")


def _check_registration(
    expected: ExpectedRegistration, registration: RegistrationResult | None
) -> Check:
    name = "registration"
    if registration is None:
        return Check(name, False, "the replay has no registration")
    if not registration.accepted:
        return Check(name, False, f"the registration was refused: {registration.reason}")
    truth = expected.reference_from_base
    off_mm = truth.distance_mm_to(registration.transform)
    off_deg = math.degrees(truth.angle_to(registration.transform))
    return Check(
        name,
        off_mm <= expected.tolerance_mm and off_deg <= expected.tolerance_deg,
        f"{off_mm:.3f} mm and {off_deg:.3f} deg off the truth, "
        f"{expected.tolerance_mm:g} mm and {expected.tolerance_deg:g} deg allowed",
    )


def _check_breaches(expected: ExpectedBreaches, found: Sequence[Breach]) -> Iterator[Check]:
    tolerance_s = expected.tolerance_ms / 1000.0 + _ROUNDING
    unmatched = list(found)
    for number, interval in enumerate(expected.intervals, start=1):
        part = " by the shaft" if interval.shaft_only else ""
        span = f"{interval.start_s:.3f} s to {interval.end_s:.3f} s{part}"
        match = next((b for b in unmatched if _offset_s(interval, b) <= tolerance_s), None)
        if match is None:
            yield Check(
                f"breach {number}", False, f"{span} was not found{_nearest(interval, found)}"
            )
            continue
        unmatched.remove(match)
        off_ms = 1000.0 * _offset_s(interval, match)
        yield Check(
            f"breach {number}",
            True,
            f"{span}: found {match.start_s:.3f} s to {match.end_s:.3f} s, "
            f"{off_ms:.1f} ms off, {expected.tolerance_ms:g} ms allowed",
        )
        off_mm = abs(match.min_signed_distance_mm - interval.min_signed_distance_mm)
        yield Check(
            f"depth of breach {number}",
            off_mm <= expected.depth_tolerance_mm + _ROUNDING,
            f"{match.min_signed_distance_mm:.3f} mm, {interval.min_signed_distance_mm:.3f} mm "
            f"expected, {expected.depth_tolerance_mm:g} mm allowed",
        )
    listed = ", ".join(f"{b.start_s:.3f} s to {b.end_s:.3f} s" for b in unmatched)
    yield Check(
        "no false breach", not unmatched, f"not expected: {listed}" if unmatched else "none found"
    )


def _offset_s(expected: ExpectedBreach, found: Breach) -> float:
    """The larger of the differences of begin and end."""
    return max(abs(found.start_s - expected.start_s), abs(found.end_s - expected.end_s))


def _nearest(expected: ExpectedBreach, found: Sequence[Breach]) -> str:
    if not found:
        return ", nor any other"
    nearest = min(found, key=lambda breach: _offset_s(expected, breach))
    return f"; nearest is {nearest.start_s:.3f} s to {nearest.end_s:.3f} s"


def _check_dropout(
    number: int, dropout: ExpectedDropout, rows: Sequence[ReportRow], stale_after_ns: int
) -> Check:
    start_ns, end_ns = round(dropout.start_s * NS_PER_S), round(dropout.end_s * NS_PER_S)
    # An invalid pose makes the state UNKNOWN at once. A missing one does so only when the last
    # good pose, of start_s at the earliest, is older than stale_after_ns.
    if dropout.kind == "missing":
        start_ns += stale_after_ns + 1
    name = f"UNKNOWN in dropout {number}"
    span = (
        f"{dropout.frame} {dropout.kind} from {start_ns / NS_PER_S:.3f} s to {dropout.end_s:.3f} s"
    )
    within = _rows_between(rows, start_ns, end_ns)
    if not within:
        return Check(name, False, f"{span}: no frame lies there or before")
    known = [row for row in within if row.state is not MarginState.UNKNOWN]
    if known:
        at_s = seconds_since(rows[0].stamp_ns, known[0].stamp_ns)
        return Check(
            name,
            False,
            f"{span}: {len(known)} of {len(within)} frames are not UNKNOWN, "
            f"the first is {known[0].state.name} at {at_s:.3f} s",
        )
    return Check(name, True, f"{span}: {len(within)} of {len(within)} frames")


def _rows_between(rows: Sequence[ReportRow], start_ns: int, end_ns: int) -> list[ReportRow]:
    """The rows of the interval; if it has none, the last row before it, whose state still holds."""
    before: list[ReportRow] = []
    within: list[ReportRow] = []
    for row in rows:
        at_ns = row.stamp_ns - rows[0].stamp_ns
        if at_ns < start_ns:
            before = [row]
        elif at_ns <= end_ns:
            within.append(row)
    return within or before
