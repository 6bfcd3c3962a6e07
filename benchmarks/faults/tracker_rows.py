"""Rows with faults of the tracker's and the robot's own data."""

import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from app.geometry import NS_PER_MS
from benchmarks.faults.bench import ALL, Bench, UnmeasuredError
from benchmarks.faults.records import Constraint, Verdict
from benchmarks.faults.results import DROPOUT, SINGLE_SOURCE, Row, Variant

INVALID, OUT_OF_VIEW = 1, 3
BATCH_NS = 30 * NS_PER_MS  # good samples after the INVALID one
AFTER_MS = 500.0  # time of observation after the limit
CREEP_MM_S, CREEP_BOUND_MM = 2.0, 8.0
JOINTS_LIMIT_MS = 100.0
V_MAX_MM_S = 50.0  # ``v_max_mm_s`` of the shipped configuration
FROZEN_MS = 1000.0  # ``frozen_after_ms`` of the shipped configuration, its default
DROPOUTS: dict[str, dict[str, Any]] = {
    "stale: all poses end": {"silent": ALL},
    "stale: the tool's poses end": {"silent": ["cautery"]},
    "lost: out of view": {"status": OUT_OF_VIEW, "nan": True},
    "INVALID": {"status": INVALID},
    "NaN": {"nan": True},
    "future stamps, 1 s": {"shift_ms": 1000.0, "shifted": ["cautery"]},
    "past stamps, 1 s": {"shift_ms": -1000.0, "shifted": ["cautery"]},
    "clock jumps forward, 5 s": {"shift_ms": 5000.0},
    "clock jumps back, 5 s": {"shift_ms": -5000.0},
}
"""Poses that end or that their source marks as unusable."""

IMPLAUSIBLE: dict[str, tuple[dict[str, Any], str]] = {
    "tool jumps 100 mm": ({"offset_mm": 100.0}, "motion model"),
    "tool jumps 10 mm": ({"offset_mm": 10.0}, ""),
    "tool turned 180 degrees": ({"turn_deg": 180.0}, "motion model"),
    "tool and tumour swapped": ({"swap": True}, "motion model"),
}
"""Poses that are wrong although their source marks them as good, and what finds them without
joints."""


def tracker_rows() -> Iterator[Row]:
    live, stale = Variant.LIVE_JOINTS, "stale_after_ms"
    for name, state in DROPOUTS.items():
        yield Row(name, live, partial(_fault, state=state, dropout=True), "the data", stale)
    yield Row("batch with one INVALID", live, _batch, "the data", "0 ms", restarts=True)
    yield Row("sender killed", live, _killed, "the data", stale)
    for variant in Variant:
        second = {live: "joints", Variant.SILENT_JOINTS: "silent joints are a fault"}.get(variant)
        for name, (state, alone) in IMPLAUSIBLE.items():
            source = second or alone
            limit, risk = (stale, "") if source else ("none", SINGLE_SOURCE)
            yield Row(name, variant, partial(_fault, state=state), source, limit, risk)
        limit, risk = (f"{CREEP_BOUND_MM:g} mm", "") if second else ("none", SINGLE_SOURCE)
        yield Row("creep 2 mm/s", variant, _creep, second or "", limit, risk)
    small = partial(_fault, state={"offset_mm": 4.0})
    yield Row("tool jumps 4 mm", live, small, "joints", stale)
    silent = partial(_fault, state={"joints": False}, limit_ms=JOINTS_LIMIT_MS)
    limit = f"{JOINTS_LIMIT_MS:g} ms"
    yield Row("joints fall silent", live, silent, "configured joints", limit)
    for name, at_rest in (("moving", False), ("at rest", True)):
        run, source = partial(_frozen, at_rest=at_rest), "sensor's history"
        yield Row(f"frozen tool, {name}", Variant.NO_ROBOT, run, source, "margin grows")


def check_cause(verdict: Verdict, *, dropout: bool = False) -> Verdict:
    """``verdict``; raises `UnmeasuredError` if the hold had another cause than the fault."""
    reasons = set(verdict.reasons)
    if not dropout and reasons and reasons <= DROPOUT:
        raise UnmeasuredError(f"hold by a delay of the machine: {', '.join(sorted(reasons))}")
    return verdict


def _fault(
    bench: Bench, state: dict[str, Any], *, limit_ms: float | None = None, dropout: bool = False
) -> Verdict:
    """Set ``state`` at the tracker, observe, and undo it."""
    limit_ms = bench.stale_ms if limit_ms is None else limit_ms
    bench.free()
    event = bench.set_fault(**state)
    try:
        begin_ns = event["last_ns"] if "silent" in state else event["ns"]
        verdict = bench.observe(begin_ns, limit_ms, limit_ms + AFTER_MS)
    finally:
        bench.set_fault(**dict.fromkeys(state))
    return check_cause(verdict, dropout=dropout)


def _batch(bench: Bench) -> Verdict:
    """A guard that stood still gets several samples at once: one INVALID, and newer good ones."""
    bench.free_patient()
    begin_ns = time.time_ns()
    with bench.stopped_guard():
        bench.set_fault(status=INVALID)
        ns = bench.set_fault(status=None)["ns"]
        bench.controller.wait_until(ns + BATCH_NS)
        woken_ns = time.time_ns()
    verdict = bench.observe(woken_ns, 0.0, AFTER_MS, free_at_ns=begin_ns)
    stood = f"the guard stood still for {(woken_ns - begin_ns) / NS_PER_MS:.0f} ms"
    return check_cause(replace(verdict, note=stood))


def _creep(bench: Bench) -> Verdict:
    limit_ms = 1000.0 * CREEP_BOUND_MM / CREEP_MM_S
    verdict = _fault(bench, {"creep_mm_s": CREEP_MM_S}, limit_ms=limit_ms)
    never = verdict.to_safe_ms is None
    seconds = (limit_ms + AFTER_MS if never else verdict.to_safe_ms) / 1000.0
    return replace(verdict, error_mm=CREEP_MM_S * seconds)


def _killed(bench: Bench) -> Verdict:
    bench.free()
    assert bench.tracker is not None
    begin_ns = max(each.content.stamp_ns for each in bench.controller.records()[0])
    bench.tracker.end(signal.SIGKILL)
    return bench.observe(begin_ns, bench.stale_ms, bench.stale_ms + AFTER_MS)


def _frozen(bench: Bench, at_rest: bool) -> Verdict:
    """The margin must grow with the time since the last change.

    A constraint counts as late if it is permissive with a margin that lacks what the tool can have
    moved, apart from ``stale_after_ms`` and 30 ms.
    """
    if at_rest:
        bench.set_fault(when="still", rest=True)
    try:
        bench.free()
        stop_mm = min(each.content.stop_mm for each in _permissive(bench))
        begin_ns = bench.set_fault(when=None if at_rest else "moving", frozen=True)["ns"]
        verdict = bench.observe(begin_ns, FROZEN_MS, FROZEN_MS + AFTER_MS)
    finally:
        bench.set_fault(frozen=None, rest=None)
    lacking = [
        V_MAX_MM_S * (each.sent_ns - begin_ns) / 1e9 - (each.content.stop_mm - stop_mm)
        for each in _permissive(bench)
        if each.sent_ns > begin_ns
    ]
    allowed_mm = V_MAX_MM_S * (bench.stale_ms / 1e3 + 0.03)
    late = max(verdict.late_constraints, sum(each > allowed_mm for each in lacking))
    error_mm = max(lacking, default=0.0)
    return check_cause(replace(verdict, late_constraints=late, error_mm=error_mm))


def _permissive(bench: Bench) -> list[Constraint]:
    return [each for each in bench.controller.records()[0] if each.permissive]
