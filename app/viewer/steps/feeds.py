"""Sources of steps for a page: a recording that was stepped through, or a live session."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
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
from app.hold import SeenHold
from app.runtime import OperatorRequest, SessionContent
from app.session import StepResult
from app.viewer.steps.replay import ReplayControl
from app.viewer.steps.view_state import ViewState, ViewStateBuilder

_QUIET_NS = NS_PER_S
"""A session without samples steps every tenth of a second: after this silence it has ended."""


class Feed(Protocol):
    """Provides the step to be shown now."""

    def now(self) -> ViewState | None:
        """Return the present step, UNKNOWN if there is none; None before the first step."""


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
        self._callback: Callable[[], None] | None = None

    def call_on_change(self, callback: Callable[[], None]) -> None:
        """Call ``callback`` at each new step, in the thread of the session."""
        self._callback = callback

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

    def _notify(self) -> None:
        if self._callback is not None:
            self._callback()


def _timeout_ns(shown: ViewState) -> int:
    """Time in ns until the poses of ``shown``, which had an age at its arrival, are stale."""
    step = shown.step
    decision = step.decision
    if decision.state is MarginState.UNKNOWN or decision.stamp is None:
        return _QUIET_NS
    limits = FreshnessLimits(shown.content.margins.stale_after_ns)
    return max(0, stale_in_ns(decision.stamp.ns, step.frame.stamp.ns, limits))
