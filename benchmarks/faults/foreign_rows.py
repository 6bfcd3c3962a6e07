"""Rows with faults by foreign nodes on the graph."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from app.geometry import NS_PER_MS
from benchmarks.faults.bench import ALL, Bench, UnmeasuredError
from benchmarks.faults.controller import rule_approaches
from benchmarks.faults.records import APPROACH_MM_S, Verdict, judge
from benchmarks.faults.results import Row, Variant
from benchmarks.faults.tracker_rows import AFTER_MS, check_cause
from benchmarks.harness.processes import Child

SECOND_SENDER_MS = 100.0
TAKEN_OVER_NS = 120 * NS_PER_MS
MAX_SEQ = 2**64 - 1
LEAD_MS = 100.0
TUMOR = {"do": "set_tumor", "frame": "needle", "position_m": [0.005, -0.004, 0.031]}
"""Near the tumour of the shipped configuration, in the frame that it moves with."""


def foreign_rows() -> Iterator[Row]:
    live, bound = Variant.LIVE_JOINTS, f"{SECOND_SENDER_MS:g} ms"
    tool = {"silent": ALL[:2], "joints": False, "offset_mm": 100.0}
    joints = {"poses": False, "joint_offset_rad": 0.02}
    graph, operator, stale = "the graph", "the operator", "stale_after_ms"
    for name, variant, run, source, limit in (
        ("second sender of the tool, 100 mm off", live, partial(_second_sender, state=tool),
         graph, bound),
        ("second sender of the tool, 100 mm off", Variant.NO_ROBOT,
         partial(_second_sender, state=tool), graph, bound),
        ("second sender of the joints", live, partial(_second_sender, state=joints), graph, bound),
        ("foreign /tf_static turns robot_base", live, _tf_static, graph, "0 ms"),
        ("foreign stale_after_ms 10000", live, _longer_stale, graph, stale),
        ("foreign stop_mm 0", live, _lower_stop, graph, stale),
        ("foreign rearm, seq 2^64-1", live, _rearm, graph, "0 ms"),
        ("foreign constraint", live, partial(_constraint, instance_id=""), graph, bound),
        ("foreign constraint, own id", live, partial(_constraint, instance_id="0" * 32), graph,
         bound),
    ):  # fmt: skip
        yield Row(name, variant, run, source, limit)
    for variant in (live, Variant.NO_ROBOT):
        name = "tool taken over after 120 of 300 ms, 10 mm off"
        yield Row(name, variant, _taken_over, graph, "0 ms", restarts=True)
    for name, run in (
        ("foreign set_tumor, ball of 1.2 mm, old nonce", _set_tumor),
        ("foreign set_tumor, 300k triangles", _large_tumor),
    ):
        yield Row(name, live, run, operator, stale, restarts=True, trials=1)
    name, risk = "foreign rearm with the present nonce", "no authentication without SROS2"
    yield Row(name, live, _rearm_as_operator, "", "none", risk)


def ask(node: Child, timeout_s: float = 30.0, **request: Any) -> dict[str, Any]:
    node.send(**request)
    return node.expect("done", timeout_s)


def _second_sender(bench: Bench, state: dict[str, Any]) -> Verdict:
    sender = bench.sender("second", {**state, "shift": bench.scene.shift, "wait": True})
    try:
        sender.expect("ready")
        bench.free()
        sender.send(go=True)
        ns = sender.expect("first")["ns"]
        verdict = bench.observe(ns, SECOND_SENDER_MS, SECOND_SENDER_MS + AFTER_MS)
    finally:
        bench.leave(sender)
    return check_cause(verdict)


def _taken_over(bench: Bench) -> Verdict:
    """Another sender goes on with the tool's poses before the last ones are stale."""
    state = {"silent": ALL, "joints": False, "offset_mm": 10.0, "shift": bench.scene.shift}
    sender = bench.sender("second", state)
    try:
        sender.expect("first")
        bench.free_patient()
        last_ns = bench.set_fault(silent=["cautery"])["last_ns"]
        bench.controller.wait_until(last_ns + TAKEN_OVER_NS)
        sender.send(set={"silent": ALL[:2]})
        ns = sender.expect("set")["ns"]
        verdict = bench.observe(ns, 0.0, AFTER_MS)
    finally:
        bench.set_fault(silent=None)
        bench.leave(sender)
    silence = f"after {(ns - last_ns) / NS_PER_MS:.0f} ms of silence"
    return check_cause(replace(verdict, note=silence))


def _tf_static(bench: Bench) -> Verdict:
    """Turn the robot's base while on hold; ask for twists along its axes."""
    controller = bench.controller
    with bench.foreign() as node:
        bench.put_on_hold()
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
            # Half a turn about an axis across the approach: an approach appears as a retreat.
            axis = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
            turned = [*(axis / np.linalg.norm(axis)).tolist(), 0.0]
            place = [-0.1466, -0.1401, -0.2105]
            base = {"parent": "reference", "child": "robot_base", "translation": place}
            controller.forget()
            ns = ask(node, do="tf_static", quaternion=turned, **base)["ns"]
            verdict = bench.observe(ns, 0.0, 1000.0, tolerance_ns=0, free_at_ns=None)
        finally:
            controller.frame = "tumor"
    return replace(verdict, note=f"{verdict.max_approach_mm_s:.0f} mm/s at most")


def _longer_stale(bench: Bench) -> Verdict:
    try:
        with bench.foreign() as node:
            reply = ask(node, do="parameters", values={"stale_after_ms": 10_000.0})
            bench.controller.wait_until(reply["reply_ns"] + round(LEAD_MS * NS_PER_MS))
            event = bench.set_fault(silent=ALL)
            last_ns = event["last_ns"]
            verdict = bench.observe(last_ns, bench.stale_ms, 1500.0, free_at_ns=reply["ns"])
        return replace(verdict, note="set" if reply["success"] else f"refused: {reply['message']}")
    finally:
        bench.set_fault(silent=None)
        bench.controller.requests.parameters({"stale_after_ms": bench.stale_ms})


def _lower_stop(bench: Bench) -> Verdict:
    stale_ms = bench.stale_ms
    try:
        with bench.foreign() as node:
            reply = ask(node, do="parameters", values={"stop_mm": 0.0})
            observe_ms = stale_ms + AFTER_MS
            verdict = bench.observe(reply["reply_ns"], stale_ms, observe_ms, free_at_ns=reply["ns"])
        if not reply["success"]:
            return replace(verdict, late_constraints=0, late_twists=0, note="refused")
        if "stale" in verdict.reasons:  # a loosening latches the hold without a fault
            raise UnmeasuredError("hold by a delay of the machine")
        return replace(verdict, note="set")
    finally:
        bench.controller.requests.parameters({"stop_mm": 1.0})


def _rearm(bench: Bench) -> Verdict:
    with bench.foreign() as node:
        bench.put_on_hold()
        bench.controller.forget()
        seen = bench.latest()
        first = ask(node, do="rearm", seq=MAX_SEQ, nonce=0)
        second = ask(node, do="rearm", seq=seen.seq, nonce=seen.content.nonce ^ 1)
        verdict = bench.observe(first["ns"], 0.0, 1000.0, free_at_ns=None)
    return replace(verdict, note=_answer(first["success"] or second["success"]))


def _rearm_as_operator(bench: Bench) -> Verdict:
    """A peer that reads the constraint can do what an operator's program does."""
    with bench.foreign() as node:
        seen = bench.put_on_hold()
        bench.controller.forget()
        reply = ask(node, do="rearm", seq=seen.seq, nonce=seen.content.nonce)
        verdict = bench.observe(reply["ns"], 0.0, 1000.0, free_at_ns=None)
    return replace(verdict, note=_answer(reply["success"]))


def _answer(success: bool) -> str:
    return "accepted" if success else "refused"


def _constraint(bench: Bench, instance_id: str) -> Verdict:
    """Publish forged constraints; judge the guard's own ones and the controller's rule."""
    with bench.foreign() as node:
        raw = bench.latest().content.raw.hex()
        ns = ask(node, do="constraint", raw=raw, instance_id=instance_id, hz=200.0)["ns"]
        bench.observe(ns, SECOND_SENDER_MS, SECOND_SENDER_MS + AFTER_MS)
    constraints, twists = bench.controller.records()
    own = [each for each in constraints if each.content.model_id != "forged"]
    limit_ns = ns + round(SECOND_SENDER_MS * NS_PER_MS)
    verdict = judge(own, twists, begin_ns=ns, limit_ns=limit_ns)
    allowed = rule_approaches(constraints, bench.scene, after_ns=limit_ns)
    note = f"{len(constraints) - len(own)} forged of {len(constraints)}; rule allows {allowed}"
    late = verdict.late_constraints + allowed
    return check_cause(replace(verdict, late_constraints=late, note=note))


def _set_tumor(bench: Bench) -> Verdict:
    """Shrink the tumour, and re-arm with the nonce of an earlier hold."""
    with bench.foreign() as node:
        old = bench.put_on_hold()
        bench.free()
        reply = ask(node, **TUMOR, radius_mm=1.2, triangles=400)
        if not reply["success"]:
            raise UnmeasuredError(f"the ball was refused: {reply['message']}")
        bench.controller.wait_until(reply["reply_ns"] + round(LEAD_MS * NS_PER_MS))
        again = ask(node, do="rearm", seq=bench.latest().seq, nonce=old.content.nonce)
        verdict = bench.observe(reply["reply_ns"], bench.stale_ms, 1500.0, free_at_ns=None)
    return replace(verdict, note=f"re-arm {_answer(again['success'])}")


def _large_tumor(bench: Bench) -> Verdict:
    """A tumour that takes seconds to prepare must not interrupt the constraint."""
    with bench.foreign() as node:
        reply = ask(node, 120.0, **TUMOR, radius_mm=20.0, triangles=300_000)
        verdict = bench.observe(reply["reply_ns"], bench.stale_ms, 1000.0, free_at_ns=None)
    sent = [each.sent_ns for each in bench.controller.records()[0] if each.sent_ns > reply["ns"]]
    gap_ms = max(np.diff(sent)) / NS_PER_MS
    seconds, client_s = ((reply[end] - reply["ns"]) / 1e9 for end in ("reply_ns", "sent_ns"))
    note = f"{seconds:.2f} s, {client_s:.2f} s of it in the client, longest gap {gap_ms:.0f} ms"
    return replace(verdict, note=note if reply["success"] else f"refused: {reply['message']}")
