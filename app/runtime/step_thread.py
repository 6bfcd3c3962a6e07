"""Run a session in a thread of its own and keep its newest step for the thread that displays."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from app.geometry import MarginGuardError
from app.hold import SeenHold
from app.runtime.content import SessionContent
from app.runtime.operator_command import Operator
from app.runtime.thread_handover import LatestValue
from app.session import StepResult

_JOIN_S = 10.0


class RunError(MarginGuardError):
    """A run does not end."""


class StepRun(Protocol):
    """Steps of a replay or a live session, which a `StepThread` takes."""

    @property
    def operator(self) -> Operator | None:
        """Access of a display to the session; None until the session exists."""

    def steps(self) -> Iterator[StepResult]:
        """Yield the steps; an operator's command waits while one is being taken."""

    @property
    def delay_ns(self) -> int:
        """By how much the last step came later than usual, 0 for one that was taken here."""

    def stop(self) -> None:
        """End `steps` soon; from any thread."""

    def pace(self) -> float:
        """Rate of the stamps over the clock, at most 1; 0 while paused."""


@dataclass(frozen=True, slots=True, eq=False)
class DeliveredStep:
    """A step of ``thread``, the content it was taken with, and when it was ready.

    ``at_ns`` is a time of the host's steady clock. ``content`` is None while the run has none.
    ``seen`` identifies the hold of the step, None without commands.
    """

    thread: "StepThread"
    step: StepResult
    content: SessionContent | None
    at_ns: int
    seen: SeenHold | None = None


class StepThread:
    """Runs ``run`` until it ends, fails or is stopped.

    ``clock_ns`` is a steady clock. ``describe`` makes one line of the error that ended the run;
    it is kept in ``failure``. ``changed()`` is called in this thread after each step and at the
    end, to wake the thread that displays.
    """

    def __init__(
        self,
        run: StepRun,
        clock_ns: Callable[[], int],
        describe: Callable[[Exception], str] = str,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.run = run
        self.failure = ""
        self._clock_ns = clock_ns
        self._describe = describe
        self._changed = changed
        self._latest: LatestValue[DeliveredStep] = LatestValue()
        self._thread = threading.Thread(target=self._work, name="MarginGuard steps", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """True when no further step will come."""
        return not self._thread.is_alive()

    def newest(self, wait_s: float) -> DeliveredStep | None:
        """Return the newest step that was not returned yet; waits at most ``wait_s`` for one."""
        return self._latest.take(wait_s)

    def present_ns(self, last: DeliveredStep) -> int:
        """The present on the clock of the stamps, when ``last`` is the last step that came.

        The present advances after a run has ended, and after another run has replaced it, so that
        its last step becomes stale.
        """
        is_running = last.thread is self and not self.is_over
        pace = self.run.pace() if is_running else 1.0
        return last.step.frame.stamp.ns + round(pace * (self._clock_ns() - last.at_ns))

    def stop(self) -> None:
        """End the run and wait until its thread has ended.

        Raises `RunError` if it has not ended after `_JOIN_S`: it may still step, and nothing may
        take its place. `failure` then says so, too.
        """
        self.run.stop()
        self._thread.join(_JOIN_S)
        if self._thread.is_alive():
            self.failure = (
                f"steps: the run has not ended after {_JOIN_S:g} s; expected it to end when it is "
                "stopped: end this process"
            )
            raise RunError(self.failure)

    def _work(self) -> None:
        try:
            for step in self.run.steps():
                # No command can replace the content while the step is being taken.
                operator = self.run.operator
                content = None if operator is None else operator.content
                seen = None if operator is None else operator.seen()
                came_ns = self._clock_ns() - self.run.delay_ns
                self._latest.put(DeliveredStep(self, step, content, came_ns, seen))
                self._changed()
        except Exception as error:  # any error: the display reports it and turns grey
            self.failure = self._describe(error)
        self._changed()
