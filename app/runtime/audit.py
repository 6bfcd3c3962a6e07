"""Audit log of a live session: holds with their causes, re-arms, changes and refused requests.

One JSON object per line (`docs/audit_log.md`). A thread writes them, so that no step waits for a
disk.
"""

import queue
import threading
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path

from app.case import ENERGY_DEVICE, Activation
from app.files.json_file import JsonLinesFile
from app.geometry import NS_PER_S
from app.runtime.content import SessionContent
from app.runtime.outputs import PassiveOutput, StepTiming
from app.runtime.requests import OperatorRequest, RateLimit
from app.session import StepResult

SCHEMA = 1

MAX_WAITING = 10_000
"""Lines that wait for the disk. Further ones are counted and reported as lost."""

_END_S = 5.0
"""Longest wait of `close` for the disk."""


class AuditLog:
    """Appends events to the file ``path`` from a thread of its own, each flushed to the disk.

    ``about`` is part of every line, such as the session's instance. ``warn(text)`` is called once,
    from that thread, if the disk refuses a line; the session continues. Raises `InputError` if the
    file cannot be opened.
    """

    def __init__(
        self,
        path: Path,
        about: Mapping[str, object],
        clock_ns: Callable[[], int],
        warn: Callable[[str], None],
    ) -> None:
        self._file = JsonLinesFile(path)
        self._about = dict(about)
        self._clock_ns = clock_ns
        self._warn = warn
        self._lost = 0
        self._failed = False
        self._waiting: queue.Queue[dict[str, object] | None] = queue.Queue(MAX_WAITING)
        self._thread = threading.Thread(target=self._write, name="audit log", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    def add(self, event: str, values: Mapping[str, object]) -> None:
        """Append a line with the system time; returns at once. Thread-safe."""
        line = {"schema": SCHEMA, **_times(self._clock_ns()), "event": event}
        line |= self._about | dict(values)
        try:
            self._waiting.put_nowait(line)
        except queue.Full:
            self._lost += 1

    def request(self, request: OperatorRequest) -> None:
        """Append a request of an operator and its outcome."""
        values: dict[str, object] = {
            "kind": str(request.kind),
            "origin": request.origin,
            "accepted": request.accepted,
            "text": request.text,
        }
        if request.not_listed:
            values["not_listed"] = request.not_listed
        self.add("request", values)

    def close(self) -> None:
        """Write all lines that wait; waits a few seconds for the disk at most."""
        try:
            self._waiting.put(None, timeout=_END_S)
        except queue.Full:
            return
        self._thread.join(_END_S)

    def _write(self) -> None:
        with self._file:
            while (line := self._waiting.get()) is not None:
                lost, self._lost = self._lost, 0
                try:
                    self._file.append({**line, "lost": lost} if lost else line)
                except OSError as error:
                    self._lost += lost + 1
                    if not self._failed:
                        self._failed = True
                        self._warn(f"audit log: {self.path} cannot be written: {error.strerror}")


class AuditOutput(PassiveOutput):
    """`Output` that lists in ``log`` how a live session starts, holds, is released and ends.

    A hold that gets one cause after another is listed once a second, 20 times at once; changes of
    the activation 5 times a second, 50 times at once.
    ``steady_ns`` is a steady clock.
    """

    def __init__(
        self, log: AuditLog, content: SessionContent, steady_ns: Callable[[], int]
    ) -> None:
        self._log = log
        self._content = content
        self._steady_ns = steady_ns
        self._limit = RateLimit(per_s=1.0, burst=20.0)
        self._hold = False
        self._causes: tuple[str, ...] = ()
        self._activation: Activation | None = None
        self._activation_limit = RateLimit(per_s=5.0, burst=50.0)
        log.add("start", _ids(content))

    def publish(self, step: StepResult, timing: StepTiming) -> bool:
        """List a hold that begins, gets another cause, or ends."""
        hold, causes = step.decision.hold, step.hold_causes
        if hold != self._hold:
            self._add("hold" if hold else "released", step)
            self._causes = causes
        elif hold and causes != self._causes and self._limit.take(self._steady_ns()):
            self._add("hold_cause", step)
            self._causes = causes
        self._hold = hold
        activation = step.frame.activation
        if activation is not self._activation and self._activation_limit.take(self._steady_ns()):
            self._log.add(ENERGY_DEVICE.name, _activation_values(activation, step))
            self._activation = activation
        return True

    def _add(self, event: str, step: StepResult) -> None:
        decision = step.decision
        values: dict[str, object] = {
            "state": decision.state.name,
            "reasons": [str(reason) for reason in decision.reasons],
            "causes": list(step.hold_causes if decision.hold else self._causes),
            "step": step.index,
            "stamp_ns": step.frame.stamp.ns,
        }
        self._log.add(event, values | ({"playback": step.playback} if step.playback else {}))

    def end(self) -> None:
        """List the end of the session."""
        self._log.add("stop", _ids(self._content))

    def _use(self, content: SessionContent) -> None:
        self._content = content
        self._log.add("content", _ids(content))


def _activation_values(activation: Activation | None, step: StepResult) -> dict[str, object]:
    state = None if activation is None else str(activation)
    return {ENERGY_DEVICE.name: state, "step": step.index, "stamp_ns": step.frame.stamp.ns}


def _ids(content: SessionContent) -> dict[str, object]:
    margins = {name: getattr(content.margins, name) for name in content.margins.ranges()}
    return {
        "name": content.name,
        "model_id": content.model_id,
        "registration_id": content.registration_id,
        "margins": margins,
    }


def _times(time_ns: int) -> dict[str, object]:
    seconds, rest_ns = divmod(time_ns, NS_PER_S)
    moment = datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return {"time": f"{moment}.{rest_ns // 1000:06d}Z", "time_ns": time_ns}
