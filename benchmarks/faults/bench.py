"""Guard, tracker and foreign nodes as programs, and a controller that judges the guard."""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from app.files.paths import shipped
from app.geometry import NS_PER_MS
from benchmarks.faults.controller import Controller
from benchmarks.faults.records import TOLERANCE_NS, Constraint, Verdict, judge
from benchmarks.faults.scene import Scene, write_scene
from benchmarks.harness.processes import CLI, Child, ChildError

ALL = ["reference", "needle", "cautery"]  # the sensors
PATIENT_MS = 300.0  # ``stale_after_ms`` of a guard that short gaps do not hold
START_S = 90.0  # a guard that starts may compile kernels
FREE_S = 45.0  # a killed publisher stays on the graph for 20 s, perhaps with a hold
STABLE_S = 0.5  # the session is permissive for so long before a fault begins
MIN_PUSHED = 5  # answers that approach in that time: without them a twist could not be judged


class UnmeasuredError(RuntimeError):
    """The fault could not be injected, or its effect could not be separated from another."""


class GuardStartError(RuntimeError):
    """The program under test does not start, so that no row can be measured."""


class Bench:
    """Starts what a row needs, keeps it for the next rows, and judges what follows a fault.

    ``stale_ms`` of the guard's configuration: None for the shipped one.
    """

    def __init__(self, folder: Path, constraint_hz: float, stale_ms: float | None) -> None:
        self.folder = folder
        self._constraint_hz, self._stale_ms = constraint_hz, stale_ms
        self.period_ms = 1000.0 / constraint_hz
        self._scene_path = folder / "scene.json"
        self.scene: Scene = write_scene(self._scene_path, time.time_ns())
        self.controller = Controller(self.scene)
        self.guard: Child | None = None
        self.tracker: Child | None = None
        self._with_robot: bool | None = None
        self._started = 0
        self.stale_ms = 0.0

    def close(self) -> None:
        for child in (self.tracker, self.guard):
            if child is not None:
                child.end()
        self.controller.close()

    def prepare(self, *, robot: bool, joints: bool) -> None:
        """Run a guard with or without a robot, and a tracker with or without joints."""
        if self.guard is None or not self.guard.running or self._with_robot != robot:
            self.start_guard(robot=robot)
        if self.tracker is None or not self.tracker.running:
            self.start_tracker()
        self.set_fault(joints=None if joints else False)

    def start_guard(
        self, *, robot: bool | None = None, wait: bool = True, stale_ms: float | None = None
    ) -> Child:
        """Start `marginguard live`; the one before ends first.

        ``stale_ms`` is its ``stale_after_ms``; None for that of the bench.
        """
        if robot is not None:
            self._with_robot = robot
        if self.guard is not None:
            self.guard.end()
        self.guard = self.another_guard(stale_ms)
        if wait:
            self.wait_for_guard()
        return self.guard

    def another_guard(self, stale_ms: float | None = None) -> Child:
        """Start a further `marginguard live` with the same configuration."""
        stale_ms = self._stale_ms if stale_ms is None else stale_ms
        path = self.folder / "live.yaml"
        values = yaml.safe_load(shipped("data", "live_example", "live.yaml").read_text())
        values["limiter"] = {"accept_simulated": True}
        if not self._with_robot:
            for key in ("robot", "registration", "clock"):
                values.pop(key, None)
        if stale_ms is not None:
            values["margins"]["stale_after_ms"] = stale_ms
        self.stale_ms = values["margins"]["stale_after_ms"]
        path.write_text(yaml.safe_dump(values))
        arguments = ("--constraint-hz", str(self._constraint_hz), "--config", str(path))
        return self.child("guard", [*CLI, "live", *arguments])

    def wait_for_guard(self) -> None:
        """Wait for a first constraint of the guard that runs now; raises `GuardStartError`."""
        self.controller.forget()
        guard = self.guard
        assert guard is not None
        deadline = time.monotonic() + START_S
        while not self.controller.wait(lambda: self.controller.latest() is not None, 0.5):
            if not guard.running or time.monotonic() > deadline:
                raise GuardStartError(f"the guard did not start: {guard.tail()}")

    def free_patient(self) -> None:
        """Run a guard with `PATIENT_MS` until the row's end, and re-arm it."""
        if self.stale_ms != PATIENT_MS:
            self.start_guard(stale_ms=PATIENT_MS)
        self.free()

    @contextmanager
    def stopped_guard(self) -> Iterator[None]:
        """The guard's process stands still (SIGSTOP) within the block."""
        guard = self.guard
        assert guard is not None
        guard.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            guard.send_signal(signal.SIGCONT)

    def start_tracker(self) -> Child:
        """Start the tracker's process; the motion continues where it would be now."""
        state = {"shift": self.scene.shift}
        self.tracker = self.sender("tracker", state)
        self.tracker.expect("first")
        return self.tracker

    def sender(self, name: str, state: dict[str, Any]) -> Child:
        """A process that sends poses and joints with the faults ``state``; ``wait``: on request."""
        arguments = [str(self._scene_path), json.dumps(state), f"{name}_peer"]
        return self.child(name, ["-m", "benchmarks.faults.tracker_peer", *arguments])

    @contextmanager
    def foreign(self) -> Iterator[Child]:
        """A foreign node that takes requests, beside a permissive session; ends with the block."""
        node = self.child("foreign", ["-m", "benchmarks.faults.foreign_peer"])
        try:
            node.expect("ready")
            self.free()
            yield node
        finally:
            self.leave(node)

    def leave(self, node: Child) -> None:
        """End a peer so that it leaves the graph."""
        node.close_input()
        node.end(signal.SIGCONT)

    def child(self, name: str, arguments: list[str]) -> Child:
        """Start a program of the bench, with its own log file."""
        self._started += 1
        return Child(name, arguments, self.folder / f"{self._started:03}_{name}.log")

    def set_fault(self, when: str | None = None, **state: Any) -> dict[str, Any]:
        """Change the tracker's faults; the event with the times of the change."""
        assert self.tracker is not None
        self.tracker.send(set=state, **({} if when is None else {"when": when}))
        event = self.tracker.expect("set")
        self.scene.shift, self.scene.rest_at = event["shift"], event["rest_at"]
        return event

    def free(self, timeout_s: float = FREE_S) -> None:
        """Re-arm until the session has been permissive for `STABLE_S`.

        Raises `UnmeasuredError` if it does not become so in time.
        """
        deadline = time.monotonic() + timeout_s
        controller = self.controller
        refusal = ""
        controller.forget()
        while time.monotonic() < deadline:
            if self.guard is not None and not self.guard.running:
                raise ChildError(f"the guard ended: {self.guard.tail()}")
            controller.wait(lambda: controller.latest() is not None, 0.5)
            latest = controller.latest()
            if latest is None:
                continue
            if latest.permissive:
                if self._is_stable():
                    return
            elif latest.content.nonce and latest.content.state != 3:
                reply = controller.requests.rearm(latest.seq, latest.content.nonce)
                refusal = reply["message"]
                controller.forget()
                if not reply["success"]:
                    controller.wait(lambda: False, 0.1)
                continue
            controller.wait(lambda: False, 0.02)
        latest = controller.latest()
        state = "no constraint" if latest is None else ", ".join(latest.content.reasons)
        raise UnmeasuredError(f"not permissive before the fault: {state}; {refusal}")

    def _is_stable(self) -> bool:
        constraints, twists = self.controller.records()
        since_ns = time.time_ns() - round(STABLE_S * 1e9)
        if not constraints or constraints[0].sent_ns > since_ns:
            return False
        recent = [each for each in constraints if each.sent_ns > since_ns]
        pushed = [each for each in twists if each.sent_ns > since_ns and each.permissive]
        is_free = bool(recent) and all(each.permissive for each in recent)
        return is_free and len(pushed) >= MIN_PUSHED

    def observe(
        self,
        begin_ns: int,
        limit_ms: float,
        observe_ms: float,
        *,
        tolerance_ns: int = TOLERANCE_NS,
        free_at_ns: int | None = -1,
    ) -> Verdict:
        """Wait, and judge what was sent from ``begin_ns`` on.

        Raises `UnmeasuredError` if nothing arrives, or if the session was not permissive at
        ``free_at_ns``, by default ``begin_ns``; None: it may be on hold.
        """
        self.controller.wait_until(begin_ns + round(observe_ms * NS_PER_MS))
        constraints, twists = self.controller.records()
        if not constraints:
            raise UnmeasuredError("no constraint arrived after the fault")
        if free_at_ns is not None:
            self._check_free(begin_ns if free_at_ns < 0 else free_at_ns)
        limit_ns = begin_ns + round(limit_ms * NS_PER_MS)
        return judge(
            constraints, twists, begin_ns=begin_ns, limit_ns=limit_ns, tolerance_ns=tolerance_ns
        )

    def _check_free(self, ns: int) -> None:
        """Raise `UnmeasuredError` unless the session was permissive at ``ns``, for some time."""
        since_ns = ns - round(0.1 * 1e9)
        before = [each for each in self.controller.records()[0] if since_ns <= each.sent_ns < ns]
        held = next((each for each in before if not each.permissive), None)
        if held is not None or not before:
            why = "no constraint" if held is None else ", ".join(held.content.reasons)
            raise UnmeasuredError(f"not permissive when the fault began: {why}")

    def latest(self) -> Constraint:
        """The last constraint; raises `UnmeasuredError` if none arrives within 5 s."""
        return self.wait_for(lambda _: True, "no constraint arrives", 5.0)

    def put_on_hold(self) -> Constraint:
        """Interrupt the poses so that the guard is on hold, with valid poses again afterwards."""
        self.set_fault(silent=ALL)
        self.wait_for(lambda seen: seen.content.hold, "no hold after silence")
        self.set_fault(silent=None)
        return self.wait_for(
            lambda seen: seen.content.hold and seen.content.state != 3, "no valid pose on hold"
        )

    def wait_for(
        self, accept: Callable[[Constraint], bool], what: str, timeout_s: float = 10.0
    ) -> Constraint:
        """Wait for a constraint; raises `UnmeasuredError` with ``what`` if none comes."""
        controller, found = self.controller, None

        def accepted() -> bool:
            nonlocal found
            found = controller.latest()
            return found is not None and accept(found)

        if not controller.wait(accepted, timeout_s) or found is None:
            raise UnmeasuredError(what)
        return found
