"""``summary.json``: the results of a replay, for people and programs, and its expected results."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from app.analysis.samples import Breach, find_breaches
from app.case import (
    ENERGY_DEVICE,
    Expected,
    ExpectedBreach,
    ExpectedBreaches,
    ExpectedDropout,
    ExpectedRegistration,
    ExpectedStructure,
)
from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_MS, NS_PER_S
from app.registration import RegistrationResult
from app.report.record import ReplayRecord, StructureRecord
from app.report.rows import ReportRow, seconds_since
from app.session import PathDepth

# Expected times are decimals in a file: rounding must not fail a tolerance that is met exactly.
_ROUNDING = 1e-9
_NS_PER_US = 1000.0
_DECIMALS = 6
ACTIVATION_AT_ENTRY = f"{ENERGY_DEVICE.name}_at_entry"
"""Activation in the first frame of a breach; only of a case with a source of it."""


def summarise(record: ReplayRecord) -> dict[str, Any]:
    """Return the content of ``summary.json``: JSON types only, None for unknown values.

    Seconds count from the first frame. Only ``timing`` depends on the rate of the replay.
    """
    rows = record.rows
    breaches = find_breaches(rows, record.margins.stale_after_ns)
    return {
        "case": record.case,
        "provenance": dict(record.provenance),
        "tip_only": record.tip_only,
        "single_source": record.single_source,
        "frames": len(rows),
        "valid_frames": sum(row.state is not MarginState.UNKNOWN for row in rows),
        "inside_frames": sum(row.inside for row in rows),
        "duration_s": _rounded(duration_ns(rows) / NS_PER_S),
        **_distances(record),
        "registration": _registration(record.registration),
        "margins": _margins(record.margins),
        "timing": step_timing(record.durations_ns),
        "expected": _expected(record, breaches),
        "notes": list(record.notes),
        **(
            {"structures": [_structure(each) for each in record.structures]}
            if record.structures
            else {}
        ),
    }


def _distances(record: ReplayRecord | StructureRecord) -> dict[str, Any]:
    """States, lowest distances and breaches of one structure."""
    rows = record.rows
    distances = [d for row in rows if (d := row.signed_distance_mm) is not None]
    breaches = find_breaches(rows, record.margins.stale_after_ns)
    return {
        "state_counts": {
            state.name: sum(row.state is state for row in rows) for state in MarginState
        },
        "state_seconds": {
            state.name: _rounded(ns / NS_PER_S) for state, ns in state_durations_ns(rows).items()
        },
        "min_signed_distance_mm": _rounded(min(distances, default=None)),
        **_deepest(record.depths.values()),
        "breaches": [_breach(breach, record) for breach in breaches],
    }


def _structure(record: StructureRecord) -> dict[str, Any]:
    return {
        "name": record.name,
        "role": str(record.role),
        **_distances(record),
        "margins": {"stop_mm": record.margins.stop_mm, "warn_mm": record.margins.warn_mm},
    }


def state_durations_ns(rows: Sequence[ReportRow]) -> dict[MarginState, int]:
    """Duration of each state in ns: the state of a frame holds until the next frame.

    The last frame and a jump back of the clock add 0, so that the values sum to `duration_ns`.
    """
    held = dict.fromkeys(MarginState, 0)
    for row, following in pairwise(rows):
        held[row.state] += max(following.stamp_ns - row.stamp_ns, 0)
    return held


def duration_ns(rows: Sequence[ReportRow]) -> int:
    """Duration of the replay in ns, without jumps back of its clock."""
    return sum(max(after.stamp_ns - row.stamp_ns, 0) for row, after in pairwise(rows))


def all_passed(summary: dict[str, Any]) -> bool:
    """True if every check of ``expected`` passed, or the case has none."""
    return all(check["result"] == "pass" for check in summary["expected"] or ())


def _breach(breach: Breach, record: ReplayRecord | StructureRecord) -> dict[str, Any]:
    inside = record.rows[breach.first : breach.last + 1]
    depth = record.depths.get(breach.first)
    first_ns, activation = record.rows[0].stamp_ns, record.rows[breach.first].activation
    return {
        "start_s": _rounded(breach.start_s),
        "end_s": _rounded(breach.end_s),
        "duration_s": _rounded(breach.duration_s),
        "min_signed_distance_mm": _rounded(breach.min_signed_distance_mm),
        "between_frames": all(row.between_frames for row in inside if row.inside),
        "deepest_s": None
        if depth is None
        else _rounded(seconds_since(first_ns, depth.deepest.stamp.ns)),
        **_deepest(() if depth is None else (depth,)),
        **({} if activation is None else {ACTIVATION_AT_ENTRY: str(activation)}),
    }


def _deepest(depths: Iterable[PathDepth]) -> dict[str, float | None]:
    """The lowest estimate and the lowest bound of the interpolated paths."""
    found = list(depths)
    estimates = [depth.deepest.proximity.signed_distance_mm for depth in found]
    bounds = [depth.lower_bound_mm for depth in found]
    return {
        "path_min_signed_distance_mm": _rounded(min(estimates, default=None)),
        "path_lower_bound_mm": _rounded(min(bounds, default=None)),
    }


def _registration(result: RegistrationResult | None) -> dict[str, Any] | None:
    if result is None:
        return None
    transform = result.transform
    return {
        "method": result.method,
        "accepted": result.accepted,
        "reason": result.reason,
        "target": transform.target,
        "source": transform.source,
        "matrix": transform.matrix.ravel().tolist(),
        "points": len(result.residuals_mm),
        "fre_mm": _rounded(result.fre_mm),
        "fle_mm": _rounded(result.fle_mm),
        "residuals_mm": [_rounded(value) for value in result.residuals_mm.tolist()],
        "leave_one_out_mm": [_rounded(value) for value in result.leave_one_out_mm.tolist()],
    }


def _margins(margins: MarginParameters) -> dict[str, float | int]:
    return {
        "stop_mm": margins.stop_mm,
        "warn_mm": margins.warn_mm,
        "k_tre": margins.k_tre,
        "v_max_mm_s": margins.v_max_mm_s,
        "stale_after_ms": margins.stale_after_ns / NS_PER_MS,
        "frozen_after_ms": margins.frozen_after_ns / NS_PER_MS,
        "release_samples": margins.release_samples,
        "release_band_mm": margins.release_band_mm,
    }


def step_timing(durations_ns: Sequence[int]) -> dict[str, float | None]:
    """Percentiles of the computing time of a step, in microseconds; None without a step."""
    in_us = np.array(durations_ns, dtype=np.float64) / _NS_PER_US
    found = np.percentile(in_us, (50.0, 99.0, 100.0)).tolist() if len(in_us) else [None] * 3
    return {
        f"step_{name}_us": None if value is None else round(value, 1)
        for name, value in zip(("p50", "p99", "max"), found, strict=True)
    }


def _expected(record: ReplayRecord, breaches: Sequence[Breach]) -> list[dict[str, str]] | None:
    if record.expected is None:
        return None
    checks = [
        *check_expected(
            record.expected,
            record.rows,
            breaches,
            record.registration,
            record.margins.stale_after_ns,
        ),
        *(
            check
            for structure in record.expected.structures
            for check in _check_structure(structure, record)
        ),
    ]
    return [
        {"check": check.name, "result": check.result, "detail": check.detail} for check in checks
    ]


def _rounded(value: float | None) -> float | None:
    if value is None or not math.isfinite(value):
        return None  # JSON has no NaN
    return round(float(value), _DECIMALS) + 0.0  # + 0.0: no negative zero


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
        frames = f"{len(rows)} frames, {expected.frames} expected"
        checks.append(Check("frames", len(rows) == expected.frames, frames))
    if expected.registration is not None:
        checks.append(_check_registration(expected.registration, registration))
    if expected.breaches is not None:
        checks.extend(_check_breaches(expected.breaches, breaches))
    for number, dropout in enumerate(expected.dropouts, start=1):
        checks.append(_check_dropout(number, dropout, rows, stale_after_ns))
    return tuple(checks)


def _check_structure(expected: ExpectedStructure, record: ReplayRecord) -> Iterable[Check]:
    for each in record.structures:
        if each.name == expected.name:
            found = find_breaches(each.rows, record.margins.stale_after_ns)
            return [
                replace(check, name=f"{each.name}: {check.name}")
                for check in _check_breaches(expected.breaches, found)
            ]
    return [Check(f"structure {expected.name}", False, "the case has no structure of that name")]


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
