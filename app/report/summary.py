"""``summary.json``: the results of a replay, for people and programs."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

from app.analysis.breaches import Breach, find_breaches
from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_MS, NS_PER_S
from app.registration import RegistrationResult
from app.report.checks import Check, check_expected
from app.report.record import ReplayRecord
from app.report.rows import ReportRow, seconds_since
from app.report.timing import StepTiming
from app.session import PathDepth

_DECIMALS = 6


def summarise(record: ReplayRecord) -> dict[str, Any]:
    """Return the content of ``summary.json``: JSON types only, None for unknown values.

    Seconds count from the first frame. Only ``timing`` depends on the rate of the replay.
    """
    rows = record.rows
    breaches = find_breaches(rows, record.margins.stale_after_ns)
    distances = [d for row in rows if (d := row.signed_distance_mm) is not None]
    return {
        "case": record.case,
        "provenance": dict(record.provenance),
        "tip_only": record.tip_only,
        "single_source": record.single_source,
        "frames": len(rows),
        "valid_frames": sum(row.state is not MarginState.UNKNOWN for row in rows),
        "inside_frames": sum(row.inside for row in rows),
        "duration_s": _rounded(duration_ns(rows) / NS_PER_S),
        "state_counts": {
            state.name: sum(row.state is state for row in rows) for state in MarginState
        },
        "state_seconds": {
            state.name: _rounded(ns / NS_PER_S) for state, ns in state_durations_ns(rows).items()
        },
        "min_signed_distance_mm": _rounded(min(distances, default=None)),
        **_deepest(record.depths.values()),
        "breaches": [_breach(breach, record) for breach in breaches],
        "registration": _registration(record.registration),
        "margins": _margins(record.margins),
        "timing": _timing(StepTiming.from_durations(record.durations_ns)),
        "expected": _expected(record, breaches),
        "notes": list(record.notes),
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


CAUTERY_AT_ENTRY = "cautery_at_entry"
"""State of the cautery in the first frame of a breach; only of a case with a source of it."""


def _breach(breach: Breach, record: ReplayRecord) -> dict[str, Any]:
    inside = record.rows[breach.first : breach.last + 1]
    depth = record.depths.get(breach.first)
    first_ns, cautery = record.rows[0].stamp_ns, record.rows[breach.first].cautery
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
        **({} if cautery is None else {CAUTERY_AT_ENTRY: str(cautery)}),
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


def _timing(timing: StepTiming | None) -> dict[str, float | None]:
    return {
        "step_p50_us": None if timing is None else round(timing.p50_us, 1),
        "step_p99_us": None if timing is None else round(timing.p99_us, 1),
        "step_max_us": None if timing is None else round(timing.max_us, 1),
    }


def _expected(record: ReplayRecord, breaches: Sequence[Breach]) -> list[dict[str, str]] | None:
    if record.expected is None:
        return None
    checks = check_expected(
        record.expected,
        record.rows,
        breaches,
        record.registration,
        record.margins.stale_after_ns,
    )
    return [_check(check) for check in checks]


def _check(check: Check) -> dict[str, str]:
    return {"check": check.name, "result": check.result, "detail": check.detail}


def _rounded(value: float | None) -> float | None:
    if value is None or not math.isfinite(value):
        return None  # JSON has no NaN
    return round(float(value), _DECIMALS) + 0.0  # + 0.0: no negative zero
