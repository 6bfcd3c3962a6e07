"""Lines of ``marginguard live``: which steps are printed, as text or JSON, and a queue before the
reader.
"""

import json
import math
import operator
import os
import queue
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any, TextIO

from app.fixture import FixtureDecision, MarginState, Reason
from app.geometry import NS_PER_S
from app.session import StepResult, ToolDistance

if TYPE_CHECKING:
    from app.runtime import SessionContent


MAX_LINES = 1000
"""Lines that may wait for the reader; later ones are dropped and counted."""

_CLOSE_S = 1.0

MIN_DURATION_NS = 2 * NS_PER_S
"""Better reasons are printed after this duration, by the stamps of the frames."""

_RANK = {reason: rank for rank, reason in enumerate(Reason)}


def state_changes(steps: Iterable[StepResult]) -> Iterator[StepResult]:
    """Yield steps with another state or hold, or worse reasons or tools, at once; better ones late.

    Close to a threshold the reasons change at every other frame while state and hold stay. The
    last printed line is therefore correct, or too severe for at most `MIN_DURATION_NS`.
    """
    printed: StepResult | None = None
    better_since_ns: int | None = None
    for step in steps:
        now_ns = step.frame.stamp.ns
        if printed is not None and _state(step) == _state(printed):
            severity, severity_printed = _severity(step), _severity(printed)
            if severity == severity_printed:
                better_since_ns = None
                continue
            worse = severity[0] > severity_printed[0]
            if not worse and all(map(operator.le, severity[1], severity_printed[1])):
                if better_since_ns is None or now_ns < better_since_ns:  # the clock jumped back
                    better_since_ns = now_ns
                if now_ns - better_since_ns < MIN_DURATION_NS:
                    continue
        printed, better_since_ns = step, None
        yield step


def _state(step: StepResult) -> tuple[MarginState, bool]:
    return step.decision.state, step.decision.hold


def _severity(step: StepResult) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Larger for worse reasons: compares the worst reason first, then the number of reasons.

    Then the states of the other tools.
    """
    reasons = tuple(-_RANK[reason] for reason in step.decision.reasons)
    return reasons, tuple(each.state for each in step.tools)


def local_time(stamp_ns: int, *, stamps_of_host: bool, now_ns: int) -> str:
    """Local time in ISO 8601 with milliseconds and offset.

    The stamp of the step if the source uses the clock of this machine. Another clock has its own
    origin, so its stamps are no times of day: the system time ``now_ns`` is used instead.
    """
    ns = stamp_ns if stamps_of_host else now_ns
    seconds, rest_ns = divmod(ns, NS_PER_S)
    moment = datetime.fromtimestamp(seconds).astimezone()
    return moment.replace(microsecond=rest_ns // 1000).isoformat(timespec="milliseconds")


def uses_color(stream: TextIO, environment: Mapping[str, str]) -> bool:
    """True if ``stream`` gets colours: NO_COLOR, then FORCE_COLOR, then TERM and the terminal."""
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR"):
        return True
    return environment.get("TERM") != "dumb" and stream.isatty()


def as_line(step: StepResult, time_text: str = "", *, color: bool = False) -> str:
    """One line with time, state, distance and reasons of a step, marked if a recording is played.

    With ``color`` the state has its symbol, its label and its colour.
    """
    decision = step.decision
    distance = (
        "" if decision.proximity is None else f" {decision.proximity.signed_distance_mm:.2f} mm"
    )
    reasons = ", ".join(str(reason) for reason in decision.reasons)
    playback = " [PLAYBACK]" if step.playback else ""
    state = _colored(decision.state) if color else decision.state.name
    governing = step.governing
    of_structure = "" if governing is None else f" {governing.name}"
    start = f"{time_text} " if time_text else ""
    warnings = "".join(f"; {each}" for each in step.warnings)
    return f"{start}{state}{of_structure}{distance}: {reasons}{warnings}{playback}"


def _structures(step: StepResult) -> dict[str, Any]:
    """Each of several structures, the tumour first, and those that are off; no key for none."""
    off = {"off": dict(step.off)} if step.off else {}
    if not step.structures:
        return off
    found = [_measured(each.name, each.decision, each.at_least_mm) for each in step.structures]
    return {"structures": found, **off}


def _measured(
    name: str, found: FixtureDecision | ToolDistance, at_least_mm: float | None
) -> dict[str, Any]:
    """The keys of a structure or tool ``name``; ``at_least_mm`` is None for a measured one."""
    mm = None if found.proximity is None else _finite(found.proximity.signed_distance_mm)
    values = {"name": name, "state": found.state.name, "signed_distance_mm": mm}
    return values if at_least_mm is None else values | {"at_least_mm": at_least_mm}


def as_json_line(
    step: StepResult, time_text: str, content: "SessionContent", *, dropped_lines: int = 0
) -> str:
    """One JSON object with the keys that ``docs/command_line.md`` lists; unknown values are null.

    The ids are those of ``content``. ``dropped_lines``: number of objects that were not printed.
    """
    decision = step.decision
    proximity, margin = decision.proximity, decision.margin
    tools = [_measured(each.name, each, each.at_least_mm) for each in step.tools]
    return json.dumps(
        {
            "time": time_text,
            "stamp_ns": step.frame.stamp.ns,
            "oldest_stamp_ns": None if decision.stamp is None else decision.stamp.ns,
            "seq": decision.seq,
            "state": decision.state.name,
            "hold": decision.hold,
            "reasons": [str(reason) for reason in decision.reasons],
            "hold_causes": list(step.hold_causes),
            "signed_distance_mm": None
            if proximity is None
            else _finite(proximity.signed_distance_mm),
            "lower_bound_mm": None if proximity is None else _finite(proximity.lower_bound_mm),
            "stop_margin_mm": None if margin is None else _finite(margin.total_mm),
            "warn_margin_mm": None if margin is None else _finite(margin.warn_total_mm),
            "tre_mm": None if margin is None else _finite(margin.tre_mm),
            "age_mm": None if margin is None else _finite(margin.age_mm),
            **_structures(step),
            **({"tools": tools} if tools else {}),
            "playback": bool(step.playback),
            "single_source": step.single_source,
            "model_id": content.model_id,
            "registration_id": content.registration_id or None,
            "dropped_lines": dropped_lines,
        },
        allow_nan=False,
    )


class LinePrinter:
    """Prints steps on ``stream`` without waiting for its reader; ``as_json`` selects JSON.

    Steps that a slow reader has missed are counted: in ``dropped_lines`` of the JSON objects, and
    in a line of text before the next step.
    """

    def __init__(self, stream: TextIO, *, as_json: bool, stamps_of_host: bool) -> None:
        self._lines = LineQueue(stream)
        self._reported = 0
        self._as_json = as_json
        self._stamps_of_host = stamps_of_host
        self._color = not as_json and uses_color(stream, os.environ)

    def print(self, step: StepResult, content: "SessionContent") -> None:
        """Print one line; raises the `OSError` of an earlier one."""
        stamp_ns = step.frame.stamp.ns
        text = local_time(stamp_ns, stamps_of_host=self._stamps_of_host, now_ns=time.time_ns())
        dropped = self._lines.dropped
        if self._as_json:
            self._lines.put(as_json_line(step, text, content, dropped_lines=dropped))
            return
        line = as_line(step, text, color=self._color)
        if dropped > self._reported:
            missed = dropped - self._reported
            line = f"{missed} lines were dropped, because they were not read in time\n{line}"
        if self._lines.put(line):
            self._reported = dropped

    def close(self) -> None:
        """Wait for the reader, 1 s at most."""
        self._lines.close()


def _colored(state: MarginState) -> str:
    display = state.display
    foreground = ";".join(str(round(255 * part)) for part in display.text_color)
    background = ";".join(str(round(255 * part)) for part in display.color)
    text = f" {display.symbol} {display.label} "
    return f"\x1b[38;2;{foreground};48;2;{background}m{text}\x1b[0m {state.name}"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


class LineQueue:
    """Writes lines to ``stream`` in their order.

    `put` returns at once. When `MAX_LINES` lines wait for a reader, it drops the new one and counts
    it in ``dropped``. An error of the stream, such as `BrokenPipeError`, is raised by the next
    `put` and by `close`.
    """

    def __init__(self, stream: TextIO, max_lines: int = MAX_LINES) -> None:
        self.dropped = 0
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(max_lines)
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._work, name="lines", daemon=True)
        self._thread.start()

    def put(self, line: str) -> bool:
        """Write ``line`` soon; False if it was dropped."""
        self._raise_error()
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            self.dropped += 1
            return False
        return True

    def close(self) -> None:
        """Wait until the reader has taken all lines, 1 s at most; the rest is lost."""
        try:
            self._lines.put(None, timeout=_CLOSE_S)
        except queue.Full:
            return
        self._thread.join(_CLOSE_S)
        self._raise_error()

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _work(self) -> None:
        try:
            while (line := self._lines.get()) is not None:
                self._write(f"{line}\n")
        except OSError as error:
            self._error = error

    def _write(self, text: str) -> None:
        """Write all of ``text`` past the buffer of the stream.

        A thread that waits for a reader would keep the buffer's lock, for which the interpreter
        waits at its end.
        """
        try:
            descriptor = self._stream.fileno()
        except (OSError, ValueError):  # a stream in memory
            self._stream.write(text)
            return
        encoding = self._stream.encoding or "utf-8"
        left = memoryview(text.encode(encoding, self._stream.errors or "strict"))
        while left:
            left = left[os.write(descriptor, left) :]
