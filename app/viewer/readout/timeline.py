"""The distance over time below the picture: of a whole recording, or of the last 30 seconds."""

from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

from app.fixture import MarginParameters
from app.geometry import NS_PER_MS, NS_PER_S
from app.viewer.readout.plot import WIDTH, Point, plot
from app.viewer.steps.feeds import ReplayFeed
from app.viewer.steps.view_state import ViewState
from app.workflow.event_notes import EventNote

_LIVE_SPAN_NS = 30 * NS_PER_S
_LIVE_STEP_NS = 200 * NS_PER_MS


class Timeline(Protocol):
    """The page's values about time, as entries of trame's state."""

    def values(self, shown: ViewState | None) -> dict[str, Any]:
        """Return the values of the moment that is shown."""

    def new_plot(self) -> dict[str, Any]:
        """Return the plot if it changed since the last call, else an empty dictionary."""

    def listed(self, shown: ViewState | None) -> ViewState | None:
        """Return the moment whose breaches and doubts are listed."""

    def place(self, note: EventNote) -> float | None:
        """Return where on the plot a note is, 0 to `WIDTH`; None if it is not in view."""

    def revision(self) -> object:
        """Return a value that changes when the page needs an update without a new step."""


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
