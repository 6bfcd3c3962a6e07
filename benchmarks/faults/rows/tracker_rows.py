"""Faults of the tracker's and the robot's own data."""

import signal
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from benchmarks.faults.bench import Bench, UnmeasuredError
from benchmarks.faults.records import NS_PER_MS, Constraint
from benchmarks.faults.row import DROPOUT, SINGLE_SOURCE, Row, Trial, Variant

ALL = ["reference", "needle", "cautery"]
INVALID, OUT_OF_VIEW = 1, 3
AFTER_MS = 500.0
"""Time of observation after the limit."""

CREEP_MM_S, CREEP_BOUND_MM = 2.0, 8.0
JOINTS_LIMIT_MS = 100.0
V_MAX_MM_S = 50.0
"""``v_max_mm_s`` of the shipped configuration."""

FROZEN_MS = 1000.0
"""``frozen_after_ms`` of the shipped configuration, its default."""


def tracker_rows() -> Iterator[Row]:
    """All rows with faults of the session's own tracker and robot."""
    yield from _dropouts()
    yield from _implausible()
    yield Row(
        "joints fall silent",
        Variant.LIVE_JOINTS,
        lambda bench: _fault(bench, {"joints": False}, limit_ms=JOINTS_LIMIT_MS),
        "configured joints",
        f"{JOINTS_LIMIT_MS:g} ms",
    )
    for name, when, state in (
        ("frozen tool, moving", "moving", {"frozen": True}),
        ("frozen tool, at rest", "still", {"frozen": True, "rest": True}),
    ):
        yield Row(
            name,
            Variant.NO_ROBOT,
            lambda bench, when=when, state=state: _frozen(bench, when, state),
            "sensor's history",
            "margin grows",
        )


def _dropouts() -> Iterator[Row]:
    """Poses that end or that their source marks as unusable."""
    faults: tuple[tuple[str, dict[str, Any]], ...] = (
        ("stale: all poses end", {"silent": ALL}),
        ("stale: the tool's poses end", {"silent": ["cautery"]}),
        ("lost: out of view", {"status": OUT_OF_VIEW, "nan": True}),
        ("INVALID", {"status": INVALID}),
        ("NaN", {"nan": True}),
        ("future stamps, 1 s", {"shift_ms": 1000.0, "shifted": ["cautery"]}),
        ("past stamps, 1 s", {"shift_ms": -1000.0, "shifted": ["cautery"]}),
        ("clock jumps forward, 5 s", {"shift_ms": 5000.0}),
        ("clock jumps back, 5 s", {"shift_ms": -5000.0}),
    )
    for name, state in faults:
        yield Row(
            name,
            Variant.LIVE_JOINTS,
            lambda bench, state=state: _fault(bench, state, dropout=True),
            "the data",
            "stale_after_ms",
        )
    yield Row("sender killed", Variant.LIVE_JOINTS, _killed, "the data", "stale_after_ms")


def _implausible() -> Iterator[Row]:
    """Poses that are wrong although their source marks them as good."""
    joints, relations = "joints", "motion model"
    for variant in Variant:
        live = variant is Variant.LIVE_JOINTS
        lost = "silent joints are a fault" if variant is Variant.SILENT_JOINTS else ""
        faults: tuple[tuple[str, dict[str, Any], str], ...] = (
            ("tool jumps 100 mm", {"offset_mm": 100.0}, joints if live else lost or relations),
            ("tool jumps 10 mm", {"offset_mm": 10.0}, joints if live else lost),
            ("tool turned 180 degrees", {"turn_deg": 180.0}, joints if live else lost or relations),
            ("tool and tumour swapped", {"swap": True}, joints if live else lost or relations),
        )
        for name, state, second_source in faults:
            yield Row(
                name,
                variant,
                lambda bench, state=state: _fault(bench, state),
                second_source,
                "stale_after_ms" if second_source else "none",
                "" if second_source else SINGLE_SOURCE,
            )
        yield Row(
            "creep 2 mm/s",
            variant,
            _creep,
            joints if live else lost,
            f"{CREEP_BOUND_MM:g} mm" if live or lost else "none",
            "" if live or lost else SINGLE_SOURCE,
        )


def check_cause(trial: Trial, *, dropout: bool = False) -> Trial:
    """``trial``; raises `UnmeasuredError` if the hold had another cause than the fault."""
    reasons = set(trial.verdict.reasons)
    if not dropout and reasons and reasons <= DROPOUT:
        raise UnmeasuredError(f"hold by a delay of the machine: {', '.join(sorted(reasons))}")
    return trial


def _fault(
    bench: Bench,
    state: dict[str, Any],
    *,
    limit_ms: float | None = None,
    dropout: bool = False,
) -> Trial:
    """Set ``state`` at the tracker, observe, and undo it."""
    limit_ms = bench.stale_ns / NS_PER_MS if limit_ms is None else limit_ms
    bench.free()
    event = bench.set_fault(**state)
    try:
        begin_ns = event["last_ns"] if "silent" in state else event["ns"]
        verdict = bench.observe(begin_ns, limit_ms=limit_ms, observe_ms=limit_ms + AFTER_MS)
    finally:
        bench.set_fault(**dict.fromkeys(state))
    return check_cause(Trial(verdict), dropout=dropout)


def _creep(bench: Bench) -> Trial:
    limit_ms = 1000.0 * CREEP_BOUND_MM / CREEP_MM_S
    trial = _fault(bench, {"creep_mm_s": CREEP_MM_S}, limit_ms=limit_ms)
    to_safe_ms = trial.verdict.to_safe_ms
    seconds = (limit_ms + AFTER_MS if to_safe_ms is None else to_safe_ms) / 1000.0
    return replace(trial, error_mm=CREEP_MM_S * seconds)


def _killed(bench: Bench) -> Trial:
    bench.free()
    assert bench.tracker is not None
    begin_ns = max(each.content.stamp_ns for each in bench.controller.records()[0])
    bench.tracker.end(signal.SIGKILL)
    limit_ms = bench.stale_ns / NS_PER_MS
    verdict = bench.observe(begin_ns, limit_ms=limit_ms, observe_ms=limit_ms + AFTER_MS)
    return Trial(verdict)


def _frozen(bench: Bench, when: str, state: dict[str, Any]) -> Trial:
    """The margin must grow with the time since the last change.

    A constraint counts as late if it is permissive with a margin that lacks what the tool can have
    moved, apart from ``stale_after_ms`` and 30 ms.
    """
    at_rest = state.get("rest")
    if at_rest:
        bench.set_fault(when="still", rest=True)
    try:
        bench.free()
        stop_mm = min(each.content.stop_mm for each in _permissive(bench))
        fault = {key: value for key, value in state.items() if key != "rest"}
        event = bench.set_fault(when=None if at_rest else when, **fault)
        begin_ns = event["ns"]
        verdict = bench.observe(begin_ns, limit_ms=FROZEN_MS, observe_ms=FROZEN_MS + AFTER_MS)
    finally:
        bench.set_fault(frozen=None, rest=None)
    lacking = [
        V_MAX_MM_S * (each.sent_ns - begin_ns) / 1e9 - (each.content.stop_mm - stop_mm)
        for each in _permissive(bench)
        if each.sent_ns > begin_ns
    ]
    allowed_mm = V_MAX_MM_S * (bench.stale_ns / 1e9 + 0.03)
    late = sum(each > allowed_mm for each in lacking)
    return check_cause(
        Trial(
            replace(verdict, late_constraints=max(verdict.late_constraints, late)),
            error_mm=max(lacking, default=0.0),
        )
    )


def _permissive(bench: Bench) -> list[Constraint]:
    return [each for each in bench.controller.records()[0] if each.permissive]
