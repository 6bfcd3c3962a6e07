"""Where a page has its steps from: a recording that was stepped through, or a session that runs."""

import threading
from collections.abc import Callable, Sequence
from typing import Protocol

from app.fixture import MarginState
from app.geometry import (
    NS_PER_MS,
    NS_PER_S,
    Freshness,
    FreshnessLimits,
    SurfaceMesh,
    freshness_of,
    stale_in_ns,
)
from app.runtime import SessionContent
from app.session import StepResult
from app.viewer.steps.replay import ReplayControl
from app.viewer.steps.view_state import ViewState, Watcher

_QUIET_NS = NS_PER_S
"""Without a source a session steps every tenth of a second: quiet for so long, it has ended."""


class Feed(Protocol):
    """What is to be seen now."""

    def now(self) -> ViewState | None:
        """The step of the present, grey when there is none; None before the first one came."""


class ReplayFeed:
    """The steps of a recording, all of them computed before the first is shown.

    So a frame that is sought is the same as one that was played to, whatever came before.
    """

    def __init__(self, shown: Sequence[ViewState], clock_ns: Callable[[], int]) -> None:
        self.shown = tuple(shown)
        self.control = ReplayControl([each.step.frame.stamp.ns for each in shown], clock_ns)

    def now(self) -> ViewState:
        """The step of the frame at which the replay stands."""
        return self.shown[self.control.frame]


class LiveFeed:
    """The newest step of a session that runs in another thread.

    A session steps when a frame comes and when one does not: when it has said nothing until the
    poses of its last step are older than poses may be, nobody knows the present any more, and that
    step is shown as UNKNOWN. ``clock_ns`` is the steady clock of this machine.
    """

    def __init__(self, watcher: Watcher, stale_after_ns: int, clock_ns: Callable[[], int]) -> None:
        self._watcher = watcher
        self._stale_after_ns = stale_after_ns
        self._clock_ns = clock_ns
        self._lock = threading.Lock()
        self._newest: ViewState | None = None
        self._came_ns = 0
        self._ended = ""
        self._wake: Callable[[], None] | None = None

    def wakes(self, wake: Callable[[], None]) -> None:
        """Call ``wake`` at each step that comes, in the thread of the session."""
        self._wake = wake

    def put(
        self, step: StepResult, content: SessionContent, margin_surface: SurfaceMesh | None
    ) -> None:
        """Take the next step, taken with ``content``; `now` returns the newest one."""
        self._watcher.use(content, margin_surface)
        shown = self._watcher.see(step)
        with self._lock:
            self._newest, self._came_ns = shown, self._clock_ns()
        self._tell()

    def end(self, why: str) -> None:
        """Say that no step will come any more, and why."""
        with self._lock:
            self._ended = why
        self._tell()

    def now(self) -> ViewState | None:
        """The newest step, as UNKNOWN when it is too old to be the present."""
        with self._lock:
            newest, came_ns, ended = self._newest, self._came_ns, self._ended
        if newest is None:
            return None
        if ended:
            return newest.as_unknown(ended)
        patience_ns = self._patience_ns(newest.step)
        limits = FreshnessLimits(patience_ns)
        if freshness_of(came_ns, self._clock_ns(), limits) is not Freshness.VALID:
            return newest.as_unknown(
                f"the session has said nothing for more than {patience_ns // NS_PER_MS} ms"
            )
        return newest

    def _patience_ns(self, step: StepResult) -> int:
        """For how long ``step`` may stay: its poses were of some age when it came."""
        decision = step.decision
        if decision.state is MarginState.UNKNOWN or decision.stamp is None:
            return _QUIET_NS
        limits = FreshnessLimits(self._stale_after_ns)
        return max(0, stale_in_ns(decision.stamp.ns, step.frame.stamp.ns, limits))

    def _tell(self) -> None:
        if self._wake is not None:
            self._wake()
