"""The distance over time below the picture: of a whole recording, or of the last 30 seconds."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray
from app.session import SHOWN_STATES
from app.viewer.feeds import ReplayFeed
from app.viewer.view_state import ViewState
from app.workflow.workflow import EventNote

WIDTH, HEIGHT = 1000.0, 100.0
_MAX_COLUMNS = 1500
"""Columns to which a long curve is reduced, each with its lowest and its highest point."""
_MAX_MM = 30.0
"""Upper end of the scale; the curve leaves the picture above it."""
_MAX_LOWER_END_MM = -2.0
"""The scale begins at this distance or below."""


@dataclass(frozen=True, slots=True)
class Point:
    """A step on the plot; ``distance_mm`` is None while the state is UNKNOWN."""

    time_ns: int
    state: MarginState
    distance_mm: float | None


def plot(
    points: Sequence[Point],
    breaches: Sequence[tuple[int, int]],
    begin_ns: int,
    end_ns: int,
    margins: MarginParameters,
) -> dict[str, Any]:
    """Compute the curve, the bands of the states, the marks of the breaches and the scale lines.

    ``points`` has one or more entries in the order of time from ``begin_ns`` to ``end_ns``;
    ``breaches`` holds begin and end of each breach in ns. The distances ``stop_mm`` and ``warn_mm``
    of ``margins`` have lines of their own. With ``top_mm``, ``mm`` and ``seconds``, of the whole
    height and width, a place on the plot becomes a distance and a time.
    """
    span_ns = max(end_ns - begin_ns, 1)
    per_ns = WIDTH / span_ns
    x = np.array([per_ns * (point.time_ns - begin_ns) for point in points])
    mm = np.array([np.nan if p.distance_mm is None else p.distance_mm for p in points], dtype=float)
    known = mm[np.isfinite(mm)]
    low = float(min(known.min(initial=0.0) - 1.0, _MAX_LOWER_END_MM))
    high = float(min(max(known.max(initial=0.0) + 1.0, 10.0), _MAX_MM))
    scale = HEIGHT / (high - low)
    y = (high - mm) * scale
    return {
        "curve": _curve(x, y),
        "bands": _bands(x, [point.state for point in points]),
        "breaches": [
            {"x": round(per_ns * (first - begin_ns), 2), "w": round(per_ns * (last - first), 2)}
            for first, last in breaches
        ],
        "lines": [
            {"y": round((high - value) * scale, 2), "label": f"{value:g}"}
            for value in (0, 5, 10, 20)
            if low < value < high
        ],
        "limits": [
            {"y": round((high - value) * scale, 2), "label": f"{name} {value:g} mm", "name": name}
            for name, value in (("stop", margins.stop_mm), ("warning", margins.warn_mm))
            if low < value < high
        ],
        "top_mm": round(high, 3),
        "mm": round(high - low, 3),
        "seconds": round(span_ns / NS_PER_S, 6),
    }


def _curve(x: FloatArray, y: FloatArray) -> str:
    """SVG path of the curve, with gaps where the distance is unknown."""
    path: list[str] = []
    columns = (
        np.floor(x * (_MAX_COLUMNS / WIDTH)).astype(int) if len(x) > 2 * _MAX_COLUMNS else None
    )
    drawing = False
    for index in range(len(x)) if columns is None else _extremes(columns, y):
        if not np.isfinite(y[index]):
            drawing = False
            continue
        path.append(f"{'L' if drawing else 'M'}{x[index]:.2f} {y[index]:.2f}")
        drawing = True
    return "".join(path)


def _extremes(columns: FloatArray, y: FloatArray) -> list[int]:
    """Indices of the lowest, the highest and one unknown point of each column, ascending."""
    kept: set[int] = set()
    begin = 0
    for _, group in groupby(columns.tolist()):
        end = begin + sum(1 for _ in group)
        part = y[begin:end]
        finite = np.isfinite(part)
        if finite.any():
            kept |= {begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))}
        if not finite.all():
            kept.add(begin + int(np.argmin(finite)))
        begin = end
    return sorted(kept)


def _bands(x: FloatArray, states: list[MarginState]) -> list[dict[str, Any]]:
    """One band from each change of the state to the next, with the state's label."""
    bands: list[dict[str, Any]] = []
    for index, state in enumerate(states):
        if bands and bands[-1]["state"] == state.name:
            continue
        if bands:
            bands[-1]["w"] = round(float(x[index]) - bands[-1]["x"], 2)
        label = state.display.label.lower()
        bands.append(
            {"state": state.name, "label": label, "x": round(float(x[index]), 2), "w": 0.0}
        )
    if bands:
        bands[-1]["w"] = round(float(x[-1]) - bands[-1]["x"], 2)
    return bands


_LIVE_SPAN_NS = 30 * NS_PER_S
_LIVE_STEP_NS = 200 * NS_PER_MS


class ReplayTimeline:
    """Timeline of a whole recording; ``breaches`` holds the first and last frame of each."""

    def __init__(self, feed: ReplayFeed, breaches: Sequence[tuple[int, int]]) -> None:
        self._control = control = feed.control
        points = [
            Point(control.time_ns(n), shown.step.decision.state, shown.distance_mm)
            for n, shown in enumerate(feed.shown)
        ]
        marks = [(control.time_ns(first), control.time_ns(last)) for first, last in breaches]
        self._last = feed.shown[-1]
        margins = self._last.content.margins
        self._drawn: dict[str, Any] | None = plot(points, marks, 0, control.duration_ns, margins)

    def values(self, shown: ViewState | None) -> dict[str, Any]:
        """Return position, duration, whether the replay plays, and its rate."""
        control = self._control
        frame = 0 if shown is None else shown.step.index
        share = control.time_ns(frame) / max(control.duration_ns, 1)
        return {
            "frame": frame,
            "frames": control.frames,
            "seconds": f"{control.time_ns(frame) / NS_PER_S:.2f}",
            "duration": f"{control.duration_ns / NS_PER_S:.2f}",
            "cursor": round(WIDTH * share, 2),
            "playing": control.playing,
            "rate": control.rate,
        }

    def new_plot(self) -> dict[str, Any]:
        """Return the plot at the first call."""
        drawn, self._drawn = self._drawn, None
        return {} if drawn is None else {"plot": drawn}

    def listed(self, shown: ViewState | None) -> ViewState | None:
        """Return the last moment of the recording, which has all of them."""
        return self._last

    def place(self, note: EventNote) -> float | None:
        """Return where the frame of a note is."""
        control = self._control
        return round(WIDTH * control.time_ns(note.frame) / max(control.duration_ns, 1), 2)

    def revision(self) -> object:
        """Return whether the replay plays, and its rate."""
        return self._control.playing, self._control.rate


class LiveTimeline:
    """Timeline of the last 30 s of the steps that were shown, redrawn five times a second."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque()
        self._drawn_ns = 0
        self._margins: MarginParameters | None = None

    def values(self, shown: ViewState | None) -> dict[str, Any]:
        """Add the moment that is shown; the cursor is at the right end.

        ``stopped`` is True while the session delivers nothing: the right end is not the present.
        """
        if shown is not None:
            now_ns = shown.step.frame.stamp.ns
            self._margins = shown.content.margins
            points = self._points
            if points and not points[-1].time_ns <= now_ns <= points[-1].time_ns + _LIVE_SPAN_NS:
                points.clear()  # the source changed its clock
            points.append(Point(now_ns, shown.step.decision.state, shown.distance_mm))
            while now_ns - points[0].time_ns > _LIVE_SPAN_NS:
                points.popleft()
        return {"cursor": WIDTH, "stopped": shown is not None and bool(shown.silent)}

    def new_plot(self) -> dict[str, Any]:
        """Return the plot if the last one is 200 ms old."""
        if not self._points or self._margins is None:
            return {}
        end_ns = self._points[-1].time_ns
        if 0 <= end_ns - self._drawn_ns < _LIVE_STEP_NS:
            return {}
        self._drawn_ns = end_ns
        begin_ns = end_ns - _LIVE_SPAN_NS
        return {"plot": plot(list(self._points), (), begin_ns, end_ns, self._margins)}

    def listed(self, shown: ViewState | None) -> ViewState | None:
        """Return the moment that is shown."""
        return shown

    def place(self, note: EventNote) -> float | None:
        """Return where a note of the last 30 s is."""
        if not self._points:
            return None
        before_ns = self._points[-1].time_ns - note.stamp_ns
        share = 1.0 - before_ns / _LIVE_SPAN_NS
        return round(WIDTH * share, 2) if 0.0 <= share <= 1.0 else None

    def revision(self) -> object:
        """Return None: only steps change this timeline."""
        return None


Timeline = ReplayTimeline | LiveTimeline
"""The page's values about time, as entries of trame's state."""

_HATCH_PATHS = {
    ".": "M3 3h2v2h-2z",
    "x": "M0 0L8 8M0 8L8 0",
    "/": "M0 8L8 0",
}
"""The SVG path, in a tile 8 wide and 8 high, of each character of matplotlib's hatches in use."""


def state_css() -> str:
    """The style sheet ``states.css``: two variables per state, and the box with its label."""
    variables = [
        f"--{key.lower()}: {shown.ground_hex}; --on-{key.lower()}: {shown.text_hex};"
        for key, shown in SHOWN_STATES.items()
    ]
    boxes = [
        f'.state[data-state="{key}"] '
        f"{{ background: var(--{key.lower()}); color: var(--on-{key.lower()}); }}"
        for key in SHOWN_STATES
    ]
    return "\n".join([":root {", *variables, "}", *boxes, ""])


def band_patterns() -> list[dict[str, str]]:
    """The name of each state with a hatch, and the SVG path of a tile 8 wide and 8 high."""
    return [
        {"state": state.name, "path": _HATCH_PATHS[state.display.hatch[0]]}
        for state in MarginState
        if state.display.hatch
    ]
