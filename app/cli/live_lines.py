"""Lines of ``marginguard live``: text, coloured on a terminal, or one JSON object per line."""

import json
import math
import os
import time
from collections.abc import Mapping
from datetime import datetime
from typing import TYPE_CHECKING, TextIO

from app.cli.line_queue import LineQueue
from app.geometry import NS_PER_S

if TYPE_CHECKING:
    from app.fixture import MarginState
    from app.runtime import SessionContent
    from app.session import StepResult


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


def as_line(step: "StepResult", time_text: str = "", *, color: bool = False) -> str:
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
    start = f"{time_text} " if time_text else ""
    return f"{start}{state}{distance}: {reasons}{playback}"


def as_json_line(
    step: "StepResult", time_text: str, content: "SessionContent", *, dropped_lines: int = 0
) -> str:
    """One JSON object with the keys that ``docs/command_line.md`` lists; unknown values are null.

    The ids are those of ``content``. ``dropped_lines``: number of objects that were not printed.
    """
    decision = step.decision
    proximity, margin = decision.proximity, decision.margin
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

    def print(self, step: "StepResult", content: "SessionContent") -> None:
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


def _colored(state: "MarginState") -> str:
    display = state.display
    foreground = ";".join(str(round(255 * part)) for part in display.text_color)
    background = ";".join(str(round(255 * part)) for part in display.color)
    text = f" {display.symbol} {display.label} "
    return f"\x1b[38;2;{foreground};48;2;{background}m{text}\x1b[0m {state.name}"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
