"""Faults of the guard's own process, and restarts."""

import random
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from marginguard_msgs.msg import FixtureConstraint
from rclpy.serialization import deserialize_message

from benchmarks.faults.bench import Bench, UnmeasuredError
from benchmarks.faults.controller import rule_approaches
from benchmarks.faults.foreign_rows import TUMOR, ask
from benchmarks.faults.records import UNKNOWN, Verdict, judge
from benchmarks.faults.results import Row, Variant
from benchmarks.harness.processes import ChildError

STOPS = 25
MIN_STOP_S, MAX_STOP_S = 0.3, 2.0
AFTER_RESTART_S = 2.0
START_S = 60.0
CLOCK = "/clock_of_a_simulation"
"""A guard takes ``/clock`` for a playback."""

ROOT = Path(__file__).resolve().parents[2]


def guard_rows() -> Iterator[Row]:
    for name, run, second_source in (
        ("guard stopped 0.3 to 2 s (SIGSTOP)", _stopped, "the clock"),
        ("guard killed on hold, restarted", partial(_restarted, on_hold=True), "the file"),
        ("guard killed, restarted", partial(_restarted, on_hold=False), "the file"),
        ("guard restarted without its accepted tumour", _other_tumor, "the file"),
        ("guard replaced, by the controller's rule", _replaced, "instance_id"),
        ("second instance beside a hold", _second_instance, "lock and graph"),
        ("driver restarted (SIGTERM)", partial(_driver, number=signal.SIGTERM), "the graph"),
        ("driver restarted (SIGKILL)", partial(_driver, number=signal.SIGKILL), "the graph"),
    ):
        trials = STOPS if run is _stopped else None
        yield Row(name, Variant.LIVE_JOINTS, run, second_source, "0 ms", trials=trials)
    name = "guard stopped and /clock paused, example controller"
    yield Row(name, Variant.LIVE_JOINTS, _paused_clock, "the system's clock", "stale_after_ms")


def _stopped(bench: Bench) -> Verdict:
    """After waking nothing is permissive: neither old data nor the commands that have waited."""
    bench.free()
    seconds = random.uniform(MIN_STOP_S, MAX_STOP_S)
    stopped_ns = time.time_ns()
    with bench.stopped_guard():
        bench.controller.wait_until(time.time_ns() + round(seconds * 1e9))
        woken_ns = time.time_ns()
    return bench.observe(woken_ns, 0.0, 600.0, tolerance_ns=0, free_at_ns=stopped_ns)


def _paused_clock(bench: Bench) -> Verdict:
    """`twist_filter.py` with ``use_sim_time`` must stand, although its clock does."""
    script = str(ROOT / "examples" / "controller" / "twist_filter.py")
    remapped = ("desired_twist:=/marginguard/desired_twist", f"/clock:={CLOCK}")
    words = [word for each in remapped for word in ("-r", each)]
    words = ["--accept-simulated", "--ros-args", "-p", "use_sim_time:=true", *words]
    example = bench.child("filter", [script, *words])
    try:
        with bench.foreign() as node:
            ask(node, do="clock", topic=CLOCK, hz=100.0)
            bench.free()
            if not bench.controller.wait(lambda: _pushes(bench), START_S):
                raise UnmeasuredError(f"the example allows no approach: {example.tail()}")
            begin_ns = ask(node, do="pause")["ns"]
            with bench.stopped_guard():
                bench.controller.wait_until(begin_ns + round((bench.stale_ms + 500.0) * 1e6))
                twists = bench.controller.safe_twists()
    finally:
        example.end(signal.SIGINT)
    limit_ns = begin_ns + round(bench.stale_ms * 1e6)
    verdict = judge([], twists, begin_ns=begin_ns, limit_ns=limit_ns)
    # A controller that sends nothing any more is as unsafe as its last command.
    if not twists[-1].permissive:
        moved = [each.sent_ns for each in twists if each.permissive and each.sent_ns > begin_ns]
        to_safe_ms = (max(moved, default=begin_ns) - begin_ns) / 1e6
        verdict = replace(verdict, to_safe_ms=to_safe_ms)
    sent = sum(each.sent_ns > begin_ns for each in twists)
    return replace(verdict, note=f"{sent} commands of the example after the stop")


def _pushes(bench: Bench) -> bool:
    return sum(each.permissive for each in bench.controller.safe_twists()[-20:]) > 10


def _restarted(bench: Bench, on_hold: bool) -> Verdict:
    """A guard that starts after SIGKILL must be on hold until it is re-armed."""
    killed_ns = _kill_and_restart(bench, on_hold)
    verdict = bench.observe(killed_ns, 0.0, 0.0, free_at_ns=None)
    return replace(verdict, note=_first_known(bench))


def _other_tumor(bench: Bench) -> Verdict:
    """A guard that starts with another tumour than an operator has accepted must name it."""
    with bench.foreign() as node:
        reply = ask(node, **TUMOR, radius_mm=10.0, triangles=400)
    if not reply["success"]:
        raise UnmeasuredError(f"the ball was refused: {reply['message']}")
    killed_ns = _kill_and_restart(bench, on_hold=False)
    verdict = bench.observe(killed_ns, 0.0, 0.0, free_at_ns=None)
    message = deserialize_message(bench.latest().content.raw, FixtureConstraint)
    causes = [each for each in message.hold_causes if "tumour" in each]
    late = verdict.late_constraints + (not causes)
    return replace(verdict, late_constraints=late, note=causes[0] if causes else "tumour not named")


def _replaced(bench: Bench) -> Verdict:
    """The rule of a controller must not allow motion by the new guard."""
    killed_ns = _kill_and_restart(bench, False, forget=False)
    limit_ns = killed_ns + round(bench.stale_ms * 1e6)
    constraints, _ = bench.controller.records()
    new = [each for each in constraints if each.sent_ns > limit_ns]
    allowed = rule_approaches(constraints, bench.scene, after_ns=limit_ns)
    verdict = judge(new, [], begin_ns=killed_ns, limit_ns=limit_ns)
    verdict = replace(verdict, to_safe_ms=None, late_constraints=allowed, late_twists=0)
    if allowed == 0:
        verdict = replace(verdict, to_safe_ms=0.0, over_limit_ms=0.0)
    return replace(verdict, note=f"{len(new)} messages of the new guard")


def _kill_and_restart(bench: Bench, on_hold: bool, *, forget: bool = True) -> int:
    """Kill and restart the guard, wait until it knows the margin and longer; time of the kill."""
    bench.free()
    if on_hold:
        bench.put_on_hold()
    guard = bench.guard
    assert guard is not None
    guard.end(signal.SIGKILL)
    killed_ns = time.time_ns()
    old = bench.latest().content.instance_id
    if forget:
        bench.controller.forget()
    bench.start_guard(wait=False)
    known = bench.wait_for(
        lambda seen: seen.content.instance_id != old and seen.content.state != UNKNOWN,
        "the restarted guard does not know the margin",
        START_S,
    )
    bench.controller.wait_until(known.sent_ns + round(AFTER_RESTART_S * 1e9))
    return killed_ns


def _first_known(bench: Bench) -> str:
    for each in bench.controller.records()[0]:
        if each.content.state != UNKNOWN:
            return f"first known: {', '.join(each.content.reasons)}"
    return ""


def _second_instance(bench: Bench) -> Verdict:
    """A second guard beside one on hold must not start, or not be permissive."""
    bench.free()
    held = bench.put_on_hold()
    bench.controller.forget()
    begin_ns = time.time_ns()
    other = bench.another_guard()

    def has_appeared() -> bool:
        recent = bench.controller.records()[0][-50:]
        own = held.content.instance_id
        return not other.running or any(
            each.content.instance_id != own and each.content.state != UNKNOWN for each in recent
        )

    try:
        deadline = time.monotonic() + START_S
        while not bench.controller.wait(has_appeared, 0.2):
            if time.monotonic() > deadline:
                raise UnmeasuredError("the second instance neither ended nor published")
        refused = not other.running
        after_s = 0.5 if refused else AFTER_RESTART_S
        bench.controller.wait_until(time.time_ns() + round(after_s * 1e9))
        verdict = bench.observe(begin_ns, 0.0, 0.0, free_at_ns=None)
    finally:
        status = other.end(signal.SIGINT)
    return replace(verdict, note=f"refused, status {status}" if refused else "started")


def _driver(bench: Bench, number: signal.Signals) -> Verdict:
    """A driver that is restarted is no second sender; a dropout may hold."""
    bench.free()
    assert bench.tracker is not None
    begin_ns = time.time_ns()
    bench.tracker.end(number)
    bench.start_tracker()
    verdict = bench.observe(begin_ns, bench.stale_ms, 3000.0)
    constraints, _ = bench.controller.records()
    accused = sum("second_sender" in each.content.reasons for each in constraints)
    try:
        bench.free()
    except (UnmeasuredError, ChildError) as error:
        return replace(verdict, to_safe_ms=None, note=f"not re-armed: {error}")
    return replace(
        verdict,
        late_constraints=verdict.late_constraints + accused,
        note=f"second_sender in {accused}; re-armed",
    )
