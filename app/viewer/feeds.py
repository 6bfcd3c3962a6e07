"""Sources of steps for a page: a recording that was stepped through, or a live session."""

import sys
import threading
from bisect import bisect_right
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

from app.fixture import MarginState
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    MarginGuardError,
    SurfaceMesh,
    freshness_of,
    stale_in_ns,
)
from app.hold import SeenHold
from app.runtime import Operator, OperatorRequest, SessionContent, stop_surface
from app.session import StepResult
from app.viewer.address import ViewerError
from app.viewer.view_state import ViewState, ViewStateBuilder
from app.workflow import Workflow

RATES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""The rates of the page: recorded time over clock time."""


@dataclass(frozen=True, slots=True)
class _Anchor:
    """A time of the recording and the clock's time at which it was played."""

    clock_ns: int
    media_ns: int


class ReplayControl:
    """Selects the frame to be shown now. It pauses at the last one.

    ``stamps_ns`` are the stamps of the frames, one or more; a jump back counts as 0 ns. The clock
    is passed in.
    """

    def __init__(self, stamps_ns: Sequence[int], clock_ns: Callable[[], int]) -> None:
        if not stamps_ns:
            raise ViewerError("recording: 0 frames; expected 1 or more")
        steps = (max(after - before, 0) for before, after in pairwise(stamps_ns))
        self._media_ns = tuple(accumulate(steps, initial=0))
        self._clock_ns = clock_ns
        self.rate = 1.0
        """Recorded time over clock time."""
        self._frame = 0
        self._anchor: _Anchor | None = None

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self._media_ns)

    @property
    def duration_ns(self) -> int:
        """Time from the first to the last frame, without jumps back of the clock."""
        return self._media_ns[-1]

    @property
    def playing(self) -> bool:
        """True while the replay plays; False at the last frame."""
        self._follow()
        return self._anchor is not None

    @property
    def frame(self) -> int:
        """Index of the frame to be shown now."""
        self._follow()
        return self._frame

    def time_ns(self, frame: int) -> int:
        """Time of ``frame`` since the first one."""
        return self._media_ns[frame]

    def play(self) -> None:
        """Play from here; at the end, from the beginning."""
        if self.frame == self.frames - 1:
            self._frame = 0
        self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def pause(self) -> None:
        """Stop at the current frame."""
        self._follow()
        self._anchor = None

    def set_rate(self, rate: float) -> None:
        """Play at one of `RATES` from now on."""
        if rate not in RATES:
            raise ViewerError(f"rate of the replay: {rate}; expected one of {RATES}")
        self._follow()
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._now_ns(self._anchor))
        self.rate = rate

    def step(self, frames: int) -> None:
        """Pause, and move by ``frames``, backward if negative, within the recording."""
        self.pause()
        self._frame = min(max(self._frame + frames, 0), self.frames - 1)

    def go_to(self, frame: int) -> None:
        """Pause at ``frame``."""
        if not 0 <= frame < self.frames:
            raise ViewerError(f"frame: {frame}; expected 0 to {self.frames - 1}")
        self.pause()
        self._frame = frame

    def seek(self, share: float) -> None:
        """Go to the frame at ``share`` (0 to 1) of the duration; a playing replay keeps playing."""
        if not 0.0 <= share <= 1.0:
            raise ViewerError(f"seek in the recording: {share}; expected 0 to 1")
        self._follow()
        self._frame = bisect_right(self._media_ns, round(share * self.duration_ns)) - 1
        if self._anchor is not None:
            self._anchor = _Anchor(self._clock_ns(), self._media_ns[self._frame])

    def _follow(self) -> None:
        """Advance to the clock's time."""
        if self._anchor is None:
            return
        now_ns = self._now_ns(self._anchor)
        self._frame = max(bisect_right(self._media_ns, now_ns) - 1, 0)
        if now_ns >= self.duration_ns:
            self._anchor = None

    def _now_ns(self, anchor: _Anchor) -> int:
        return anchor.media_ns + round((self._clock_ns() - anchor.clock_ns) * self.rate)


_QUIET_NS = NS_PER_S
"""A session without samples steps every tenth of a second: after this silence it has ended."""


class ReplayFeed:
    """The steps of a recording, all computed before the first is shown.

    A frame therefore looks the same after a seek and after playing to it.
    """

    def __init__(self, shown: Sequence[ViewState], clock_ns: Callable[[], int]) -> None:
        self.shown = tuple(shown)
        self.control = ReplayControl([each.step.frame.stamp.ns for each in shown], clock_ns)

    def now(self) -> ViewState:
        """Return the step of the current frame."""
        return self.shown[self.control.frame]


class LiveFeed:
    """The newest step of a live session, put from another thread.

    A session also steps without new samples. If no step arrives until the poses of the last one are
    stale, the last step is shown as UNKNOWN. ``clock_ns`` is a steady clock of this machine.
    ``silence`` says why no step comes, empty where that is not known.
    """

    def __init__(
        self,
        builder: ViewStateBuilder,
        clock_ns: Callable[[], int],
        silence: Callable[[], str] = lambda: "",
    ) -> None:
        self._builder = builder
        self._clock_ns = clock_ns
        self._silence = silence
        self._of_session: OperatorRequest | None = None
        self._lock = threading.Lock()
        self._newest: ViewState | None = None
        self._came_ns = 0
        self._ended = ""
        self._request: OperatorRequest | None = None
        self._notify: Callable[[], None] = lambda: None

    def call_on_change(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` at each new step, in the thread of the session."""
        self._notify = callback

    def put(
        self,
        step: StepResult,
        content: SessionContent,
        margin_surface: SurfaceMesh | None,
        seen: SeenHold | None = None,
        delay_ns: int = 0,
    ) -> None:
        """Store the next step, taken with ``content``; `now` returns the newest one.

        ``seen`` identifies the hold of the constraint that was published with it. ``delay_ns``: how
        much later than usual it came; it is as old as that.
        """
        self._builder.use(content, margin_surface)
        shown = replace(self._builder.observe(step), seen=seen)
        with self._lock:
            self._newest, self._came_ns = shown, self._clock_ns() - delay_ns
        self._notify()

    def list_of_session(self, request: OperatorRequest | None) -> None:
        """Show the last request that the session has listed, if it is another one than before."""
        if request is not self._of_session and request is not None:
            self.list_request(request)
        self._of_session = request

    def list_request(self, request: OperatorRequest) -> None:
        """Show ``request`` as the last one; from any thread."""
        with self._lock:
            self._request = request
        self._notify()

    def end(self, why: str) -> None:
        """Show the newest step as UNKNOWN with the cause ``why``: no further step will come."""
        with self._lock:
            self._ended = why
        self._notify()

    def now(self) -> ViewState | None:
        """Return the newest step, as UNKNOWN if its poses are stale by now."""
        with self._lock:
            newest, came_ns, ended = self._newest, self._came_ns, self._ended
            request = self._request
        if newest is None:
            return None
        newest = newest if request is None else replace(newest, request=request)
        if ended:
            return newest.as_unknown(ended)
        timeout_ns = _timeout_ns(newest)
        limits = FreshnessLimits(timeout_ns)
        if freshness_of(came_ns, self._clock_ns(), limits) is not Freshness.VALID:
            silent = f"the session has sent nothing for more than {timeout_ns // NS_PER_MS} ms"
            return newest.as_unknown(self._silence() or silent)
        return newest


def _timeout_ns(shown: ViewState) -> int:
    """Time in ns until the poses of ``shown``, which had an age at its arrival, are stale."""
    step = shown.step
    decision = step.decision
    if decision.state is MarginState.UNKNOWN or decision.stamp is None:
        return _QUIET_NS
    limits = FreshnessLimits(shown.content.margins.stale_after_ns)
    return max(0, stale_in_ns(decision.stamp.ns, step.frame.stamp.ns, limits))


Feed = ReplayFeed | LiveFeed
"""Provides the step to be shown now."""


class LiveSteps:
    """Puts every step of a session that began with ``content`` into ``feed``.

    The margin surface of another tumour or stop margin takes a second to compute in ``workers``;
    until then there is none, never that of the content before.
    ``workflow`` records the poses.
    """

    def __init__(
        self,
        feed: LiveFeed,
        content: SessionContent,
        margin_surface: SurfaceMesh | None,
        workers: Executor,
        workflow: Workflow | None = None,
    ) -> None:
        self._feed = feed
        self._content = content
        self._margin_surface = margin_surface
        self._workers = workers
        self._workflow = workflow
        self._computing: Future[SurfaceMesh | None] | None = None

    def put(self, step: StepResult, operator: Operator, delay_ns: int = 0) -> None:
        """Take the next step, with what ``operator`` says of the session at this moment.

        ``delay_ns``: how much later than usual it came.
        """
        self._use(operator.content)
        if self._computing is not None and self._computing.done():
            self._margin_surface = _result(self._computing)
            self._computing = None
        if self._workflow is not None:
            self._workflow.observe(step)
        self._feed.put(step, self._content, self._margin_surface, operator.seen(), delay_ns)
        self._feed.list_of_session(operator.last_request)

    def _use(self, content: SessionContent) -> None:
        before, self._content = self._content, content
        is_same_stop = content.margins.stop_mm == before.margins.stop_mm
        if content.tumor is before.tumor and is_same_stop:
            return
        self._margin_surface = None
        self._computing = self._workers.submit(stop_surface, content)


def _result(computing: "Future[SurfaceMesh | None]") -> SurfaceMesh | None:
    """The surface; None where it cannot be made, which does not end the session."""
    try:
        return computing.result()
    except MarginGuardError as error:
        print(f"no margin surface is shown: {error}", file=sys.stderr)
        return None
