"""One step of a session with everything that a page shows of it."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from app.case import TrackingFrame
from app.fixture import MarginState, Reason
from app.geometry import NS_PER_MS, NS_PER_S, FloatArray, Freshness, SurfaceMesh, Transform
from app.hold import SeenHold
from app.runtime import OperatorRequest, SessionContent
from app.scene.shown_margin import TransformHealth, TransformWatchdog
from app.session import BreachList, BreachLog, SetupDoubts, StepResult
from app.workflow.steps import required_frames

_WINDOW_NS = 300 * NS_PER_MS
_STEADY_MM_S = 2.0
"""Below this speed a change within the window is noise of the tracker."""


class Trend(StrEnum):
    """Direction of change of the signed distance."""

    APPROACHING = "approaching"
    STEADY = "steady"
    RETREATING = "retreating"
    NONE = ""
    """Not enough samples."""


class TrendMeter:
    """Trend over the last 0.3 s; an unknown distance or a jump in time resets it."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float]] = deque()

    def update(self, stamp_ns: int, signed_distance_mm: float | None) -> Trend:
        """Add the distance of one step, None if unknown; return the trend."""
        points = self._points
        if points and not 0 < stamp_ns - points[-1][0] <= _WINDOW_NS:
            points.clear()
        if signed_distance_mm is None:
            points.clear()
            return Trend.NONE
        points.append((stamp_ns, signed_distance_mm))
        while stamp_ns - points[0][0] > _WINDOW_NS:
            points.popleft()
        span_ns = stamp_ns - points[0][0]
        if span_ns < _WINDOW_NS // 3:
            return Trend.NONE
        speed_mm_s = (signed_distance_mm - points[0][1]) / (span_ns / NS_PER_S)
        if abs(speed_mm_s) < _STEADY_MM_S:
            return Trend.STEADY
        return Trend.RETREATING if speed_mm_s > 0.0 else Trend.APPROACHING


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """One step, and the results of earlier steps that are shown with it.

    ``content``: the session's content at this step. ``margin_surface``: the surface at its stop
    margin; None while it is not computed, and for a margin of 0. ``measured``: the last good sample
    of every edge so far. ``breaches``: how often the state has become POSITIVE so far, so that a
    page that skips steps misses none. ``breach_list``: the breaches so far, counted as in the
    report; ``doubts``: what cannot be right in the set-up. ``marks``: positions of the tool inside
    the tumour, in the tumour's frame, the first ``marked`` of them up to this step. ``silent``: why
    the step is outdated, empty while it is not. ``request``: the last request to change a live
    session. ``seen``: identifies the hold of a live session that an operator may end; None without
    one. ``elapsed_s``: time since the first step, without jumps back of the clock.
    """

    step: StepResult
    content: SessionContent
    margin_surface: SurfaceMesh | None
    measured: tuple[Transform, ...]
    lamps: tuple[TransformHealth, ...]
    trend: Trend
    breaches: int
    marks: Sequence[FloatArray]
    marked: int
    breach_list: BreachList = field(default_factory=BreachList)
    doubts: tuple[str, ...] = ()
    silent: str = ""
    request: OperatorRequest | None = None
    seen: SeenHold | None = None
    elapsed_s: float = 0.0

    @property
    def begin_ns(self) -> int:
        """Stamp of the first step, moved by the jumps back of the clock."""
        return self.step.frame.stamp.ns - round(self.elapsed_s * NS_PER_S)

    @property
    def distance_mm(self) -> float | None:
        """The signed distance that may be shown: None while the state is UNKNOWN."""
        return known_distance_mm(self.step)

    def as_unknown(self, why: str) -> "ViewState":
        """The step as UNKNOWN because no step followed: without distance, plane or links."""
        reasons = (Reason.STALE, *(r for r in self.step.decision.reasons if r is Reason.LATCHED))
        decision = self.step.decision._replace(
            state=MarginState.UNKNOWN,
            reasons=reasons,
            constraint_is_current=False,
        )
        step = replace(self.step, decision=decision, links={})
        return replace(self, step=step, trend=Trend.NONE, silent=why, seen=None)


def known_distance_mm(step: StepResult) -> float | None:
    """The signed distance of ``step``, None while its state is UNKNOWN."""
    decision = step.decision
    proximity = decision.proximity
    if decision.state is MarginState.UNKNOWN or proximity is None or not proximity.is_finite:
        return None
    return float(proximity.signed_distance_mm)


class ViewStateBuilder:
    """Turns each step of a session into a `ViewState`, in order.

    Call `use` before the first step of a changed session.
    """

    def __init__(self, content: SessionContent, margin_surface: SurfaceMesh | None = None) -> None:
        self._content = content
        self._margin_surface = margin_surface
        self._required = required_frames(content)
        self._named: set[str] = set()
        self._watchdog = TransformWatchdog(content.margins.stale_after_ns)
        self._trend = TrendMeter()
        self._doubts = SetupDoubts(content)
        self._edges: dict[tuple[str, str], Transform] = {}
        self._measured: tuple[Transform, ...] = ()
        self._breaches = 0
        self._breach_log = BreachLog(
            content.tumor, content.margins.stale_after_ns, content.structure_surfaces
        )
        self._marks: list[FloatArray] = []
        self._inside = False
        self._elapsed_ns = 0
        self._last_ns: int | None = None

    def use(self, content: SessionContent, margin_surface: SurfaceMesh | None) -> None:
        """Attach these to the next steps. The breach marks of another tumour are dropped."""
        if content.tumor is not self._content.tumor:
            self._marks = []
        self._breach_log.use(
            content.tumor, content.margins.stale_after_ns, content.structure_surfaces
        )
        self._doubts.stale_after_ns = content.margins.stale_after_ns
        if content.tool_from_tip is not self._content.tool_from_tip:
            self._doubts.use_tip(content.tool_from_tip)
        self._content, self._margin_surface = content, margin_surface

    def observe(self, step: StepResult) -> ViewState:
        """Return what to show of ``step``, the next one."""
        now_ns = step.frame.stamp.ns
        self._elapsed_ns += 0 if self._last_ns is None else max(now_ns - self._last_ns, 0)
        self._last_ns = now_ns
        good = [pose.transform for pose in step.frame.poses if pose.transform is not None]
        if good:
            self._edges |= {(edge.target, edge.source): edge for edge in good}
            self._measured = tuple(self._edges.values())
        inside = step.decision.state is MarginState.POSITIVE
        self._breaches += inside and not self._inside
        self._inside = inside
        distance_mm, proximity = known_distance_mm(step), step.decision.proximity
        if distance_mm is not None and proximity is not None and distance_mm < 0.0:
            self._marks.append(proximity.on_tool_mm)
        return ViewState(
            step=step,
            content=self._content,
            margin_surface=self._margin_surface,
            measured=self._measured,
            lamps=self._lamps(step.frame),
            trend=self._trend.update(step.frame.stamp.ns, distance_mm),
            breaches=self._breaches,
            marks=self._marks,
            marked=len(self._marks),
            breach_list=self._breach_log.observe(step),
            doubts=self._doubts.observe(step),
            elapsed_s=self._elapsed_ns / NS_PER_S,
        )

    def _lamps(self, frame: TrackingFrame) -> tuple[TransformHealth, ...]:
        """Health of every tracked frame, and of required frames that never came."""
        for sample in frame.poses:
            self._watchdog.observe(sample)
        known = {sample.source for sample in frame.poses} | self._named
        self._named = known
        never = (
            TransformHealth(n, Freshness.MISSING, None) for n in self._required if n not in known
        )
        return (*self._watchdog.check(frame.stamp.ns), *never)
