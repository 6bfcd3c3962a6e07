"""The distance over time below the picture: of a whole recording, or of the last seconds."""

from collections import deque
from collections.abc import Sequence
from typing import Any, Protocol

from app.geometry import NS_PER_MS, NS_PER_S
from app.viewer.readout.plot import WIDTH, Point, plot
from app.viewer.steps.feeds import ReplayFeed
from app.viewer.steps.view_state import ViewState

_LIVE_SPAN_NS = 30 * NS_PER_S
_LIVE_STEP_NS = 200 * NS_PER_MS


class Timeline(Protocol):
    """What the page draws and says of time, as values of trame's state."""

    def at(self, shown: ViewState | None) -> dict[str, Any]:
        """Of the moment that is shown."""

    def news(self) -> dict[str, Any]:
        """What has changed since the last call beside the moment."""

    def mark(self) -> object:
        """Something that changes when the page has to be told, although no step came."""


class ReplayTimeline:
    """All of a recording, with its ``breaches``: first and last frame of each."""

    def __init__(self, feed: ReplayFeed, breaches: Sequence[tuple[int, int]]) -> None:
        self._control = control = feed.control
        points = [
            Point(control.time_ns(n), shown.step.decision.state, shown.distance_mm)
            for n, shown in enumerate(feed.shown)
        ]
        marks = [(control.time_ns(first), control.time_ns(last)) for first, last in breaches]
        self._drawn: dict[str, Any] | None = plot(points, marks, 0, control.duration_ns)
        self._first_ns = feed.shown[0].step.frame.stamp.ns

    def at(self, shown: ViewState | None) -> dict[str, Any]:
        """Where the replay stands: frame, seconds, whether it plays and how fast."""
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

    def news(self) -> dict[str, Any]:
        """The plot, once."""
        drawn, self._drawn = self._drawn, None
        return {} if drawn is None else {"plot": drawn}

    def mark(self) -> object:
        """Whether it plays, and how fast."""
        return self._control.playing, self._control.rate


class LiveTimeline:
    """The last half minute of the steps that were shown, drawn anew five times a second."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque()
        self._drawn_ns = 0

    def at(self, shown: ViewState | None) -> dict[str, Any]:
        """Take in the moment that is shown; the cursor is at the right end.

        Whose session is silent has stopped: its right end is not now any more.
        """
        if shown is not None:
            now_ns = shown.step.frame.stamp.ns
            points = self._points
            if points and not points[-1].time_ns <= now_ns <= points[-1].time_ns + _LIVE_SPAN_NS:
                points.clear()  # the source has another clock now
            points.append(Point(now_ns, shown.step.decision.state, shown.distance_mm))
            while now_ns - points[0].time_ns > _LIVE_SPAN_NS:
                points.popleft()
        return {"cursor": WIDTH, "stopped": shown is not None and bool(shown.silent)}

    def news(self) -> dict[str, Any]:
        """The plot, when the last one is old enough."""
        if not self._points:
            return {}
        end_ns = self._points[-1].time_ns
        if 0 <= end_ns - self._drawn_ns < _LIVE_STEP_NS:
            return {}
        self._drawn_ns = end_ns
        return {"plot": plot(list(self._points), (), end_ns - _LIVE_SPAN_NS, end_ns)}

    def mark(self) -> object:
        """Nothing but steps changes it."""
        return None
