"""Faults by foreign nodes on the graph."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.faults.bench import Bench, UnmeasuredError
from benchmarks.harness.processes import Child
from benchmarks.faults.records import APPROACH_MM_S, NS_PER_MS, judge
from benchmarks.faults.row import Row, Trial, Variant
from benchmarks.faults.rows.tracker_rows import AFTER_MS, ALL, check_cause
from benchmarks.faults.rule import rule_approaches

SECOND_SENDER_MS = 100.0
MAX_SEQ = 2**64 - 1
TUMOR_AT_M = [0.005, -0.004, 0.031]
"""Near the tumour of the shipped configuration, in the frame that it moves with."""

LEAD_MS = 100.0


def foreign_rows() -> Iterator[Row]:
    """All rows in which another node interferes."""
    bound = f"{SECOND_SENDER_MS:g} ms"
    for variant in (Variant.LIVE_JOINTS, Variant.NO_ROBOT):
        yield Row(
            "second sender of the tool, 100 mm off",
            variant,
            lambda bench: _second_sender(
                bench, {"silent": ALL[:2], "joints": False, "offset_mm": 100.0}
            ),
            "the graph",
            bound,
        )
    joints = {"poses": False, "joint_offset_rad": 0.02}
    for name, run, limit in (
        ("second sender of the joints", lambda bench: _second_sender(bench, joints), bound),
        ("foreign /tf_static turns robot_base", _tf_static, "0 ms"),
        ("foreign stale_after_ms 10000", _longer_stale, "stale_after_ms"),
        ("foreign stop_mm 0", _lower_stop, "stale_after_ms"),
        ("foreign rearm, seq 2^64-1", _rearm, "0 ms"),
        ("foreign constraint", lambda bench: _constraint(bench, ""), bound),
        ("foreign constraint, own id", lambda bench: _constraint(bench, "0" * 32), bound),
    ):
        yield Row(name, Variant.LIVE_JOINTS, run, "the graph", limit)
    yield Row(
        "foreign set_tumor, ball of 1.2 mm, old nonce",
        Variant.LIVE_JOINTS,
        _set_tumor,
        "the operator",
        "stale_after_ms",
        restarts=True,
        trials=1,
    )
    yield Row(
        "foreign set_tumor, 300k triangles",
        Variant.LIVE_JOINTS,
        _large_tumor,
        "the operator",
        "stale_after_ms",
        restarts=True,
        trials=1,
    )
    yield Row(
        "foreign rearm with the present nonce",
        Variant.LIVE_JOINTS,
        _rearm_as_operator,
        "",
        "none",
        "no authentication without SROS2",
    )


def _second_sender(bench: Bench, state: dict[str, Any]) -> Trial:
    sender = bench.sender("second", {**state, "shift": bench.scene.shift, "wait": True})
    try:
        sender.expect("ready")
        bench.free()
        sender.send(go=True)
        event = sender.expect("first")
        verdict = bench.observe(
            event["ns"], limit_ms=SECOND_SENDER_MS, observe_ms=SECOND_SENDER_MS + AFTER_MS
        )
    finally:
        bench.leave(sender)
    return check_cause(Trial(verdict))


def _tf_static(bench: Bench) -> Trial:
    """Turn the robot's base while on hold; ask for twists along its axes."""
    with bench.foreign() as node:
        bench.free()
        bench.put_on_hold()
        return _turn_base(bench, node)


def _turn_base(bench: Bench, node: Child) -> Trial:
    controller = bench.controller
    controller.frame = "robot_base"
    try:
        controller.forget()
        if not controller.wait(lambda: len(controller.records()[1]) >= 20, 5.0):
            raise UnmeasuredError("no answers to twists along the axes of robot_base")
        before = max(each.approach_mm_s for each in controller.records()[1])
        if before > APPROACH_MM_S:
            raise UnmeasuredError(f"{before:.1f} mm/s on hold without a fault")
        truth = bench.scene.truths[0]
        direction = truth.base_from_tumor @ truth.approach
        # Half a turn about an axis across the approach, so that an approach appears as a retreat.
        axis = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
        axis /= np.linalg.norm(axis)
        controller.forget()
        node.send(
            do="tf_static",
            parent="reference",
            child="robot_base",
            translation=[-0.1466, -0.1401, -0.2105],
            quaternion=[*axis.tolist(), 0.0],
        )
        event = node.expect("done")
        verdict = bench.observe(
            event["ns"], limit_ms=0.0, observe_ms=1000.0, tolerance_ns=0, free_at_ns=None
        )
        return Trial(verdict, note=f"{verdict.max_approach_mm_s:.0f} mm/s at most")
    finally:
        controller.frame = "tumor"


def _longer_stale(bench: Bench) -> Trial:
    stale_ms = bench.stale_ns / NS_PER_MS
    try:
        with bench.foreign() as node:
            bench.free()
            reply = _request(node, do="parameters", values={"stale_after_ms": 10_000.0})
            bench.controller.wait_until(reply["reply_ns"] + round(LEAD_MS * NS_PER_MS))
            event = bench.set_fault(silent=ALL)
            verdict = bench.observe(
                event["last_ns"], limit_ms=stale_ms, observe_ms=1500.0, free_at_ns=reply["ns"]
            )
        return Trial(verdict, note="set" if reply["success"] else f"refused: {reply['message']}")
    finally:
        bench.set_fault(silent=None)
        bench.controller.set_parameters(stale_after_ms=stale_ms)


def _lower_stop(bench: Bench) -> Trial:
    stale_ms = bench.stale_ns / NS_PER_MS
    try:
        with bench.foreign() as node:
            bench.free()
            reply = _request(node, do="parameters", values={"stop_mm": 0.0})
            verdict = bench.observe(
                reply["reply_ns"],
                limit_ms=stale_ms,
                observe_ms=stale_ms + AFTER_MS,
                free_at_ns=reply["ns"],
            )
        if not reply["success"]:
            return Trial(replace(verdict, late_constraints=0, late_twists=0), note="refused")
        if "stale" in verdict.reasons:  # a loosening latches the hold without a fault
            raise UnmeasuredError("hold by a delay of the machine")
        return Trial(verdict, note="set")
    finally:
        bench.controller.set_parameters(stop_mm=1.0)


def _rearm(bench: Bench) -> Trial:
    with bench.foreign() as node:
        bench.free()
        bench.put_on_hold()
        bench.controller.forget()
        seen = bench.latest()
        first = _request(node, do="rearm", seq=MAX_SEQ, nonce=0)
        second = _request(node, do="rearm", seq=seen.seq, nonce=seen.content.nonce ^ 1)
        verdict = bench.observe(first["ns"], limit_ms=0.0, observe_ms=1000.0, free_at_ns=None)
    accepted = first["success"] or second["success"]
    return Trial(verdict, note="accepted" if accepted else "refused")


def _rearm_as_operator(bench: Bench) -> Trial:
    """A peer that reads the constraint can do what an operator's program does."""
    with bench.foreign() as node:
        bench.free()
        seen = bench.put_on_hold()
        bench.controller.forget()
        reply = _request(node, do="rearm", seq=seen.seq, nonce=seen.content.nonce)
        verdict = bench.observe(reply["ns"], limit_ms=0.0, observe_ms=1000.0, free_at_ns=None)
    return Trial(verdict, note="accepted" if reply["success"] else "refused")


def _constraint(bench: Bench, instance_id: str) -> Trial:
    """Publish forged constraints; judge the guard's own ones and the controller's rule."""
    with bench.foreign() as node:
        bench.free()
        seen = bench.latest()
        node.send(do="constraint", raw=seen.content.raw.hex(), instance_id=instance_id, hz=200.0)
        event = node.expect("done")
        bench.observe(
            event["ns"], limit_ms=SECOND_SENDER_MS, observe_ms=SECOND_SENDER_MS + AFTER_MS
        )
    constraints, twists = bench.controller.records()
    own = [each for each in constraints if each.content.model_id != "forged"]
    limit_ns = event["ns"] + round(SECOND_SENDER_MS * NS_PER_MS)
    verdict = judge(own, twists, begin_ns=event["ns"], limit_ns=limit_ns)
    allowed = rule_approaches(constraints, bench.scene, after_ns=limit_ns)
    note = f"{len(constraints) - len(own)} forged of {len(constraints)}; rule allows {allowed}"
    return check_cause(
        Trial(replace(verdict, late_constraints=verdict.late_constraints + allowed), note=note)
    )


def _set_tumor(bench: Bench) -> Trial:
    """Shrink the tumour, and re-arm with the nonce of an earlier hold."""
    with bench.foreign() as node:
        bench.free()
        old = bench.put_on_hold()
        bench.free()
        reply = _request(
            node,
            do="set_tumor",
            frame="needle",
            position_m=TUMOR_AT_M,
            radius_mm=1.2,
            triangles=400,
        )
        if not reply["success"]:
            raise UnmeasuredError(f"the ball was refused: {reply['message']}")
        bench.controller.wait_until(reply["reply_ns"] + round(LEAD_MS * NS_PER_MS))
        again = _request(node, do="rearm", seq=bench.latest().seq, nonce=old.content.nonce)
        stale_ms = bench.stale_ns / NS_PER_MS
        verdict = bench.observe(
            reply["reply_ns"], limit_ms=stale_ms, observe_ms=1500.0, free_at_ns=None
        )
    return Trial(verdict, note=f"re-arm {'accepted' if again['success'] else 'refused'}")


def _large_tumor(bench: Bench) -> Trial:
    """A tumour that takes seconds to prepare must not interrupt the constraint."""
    with bench.foreign() as node:
        bench.free()
        node.send(
            do="set_tumor",
            frame="needle",
            position_m=TUMOR_AT_M,
            radius_mm=20.0,
            triangles=300_000,
        )
        reply = node.expect("done", 120.0)
        stale_ms = bench.stale_ns / NS_PER_MS
        verdict = bench.observe(
            reply["reply_ns"], limit_ms=stale_ms, observe_ms=1000.0, free_at_ns=None
        )
    sent = [each.sent_ns for each in bench.controller.records()[0] if each.sent_ns > reply["ns"]]
    gap_ms = max(np.diff(sent)) / NS_PER_MS
    seconds = (reply["reply_ns"] - reply["ns"]) / 1e9
    client_s = (reply["sent_ns"] - reply["ns"]) / 1e9
    note = f"{seconds:.2f} s, {client_s:.2f} s of it in the client, longest gap {gap_ms:.0f} ms"
    return Trial(verdict, note=note if reply["success"] else f"refused: {reply['message']}")


def _request(node: Child, **request: Any) -> dict[str, Any]:
    node.send(**request)
    reply: dict[str, Any] = node.expect("done", 30.0)
    return reply
