"""A session that steps in a thread of its own and leaves its newest step for the scene."""

import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

from app.bridge.control import SessionChanges
from app.bridge.latest_value import LatestValue
from app.fixture import FixtureDecision, MarginState
from app.session import Session, StepResult

from .jobs import one_line

_JOIN_S = 10.0


class Steps(Protocol):
    """What a run runs: a replay or a live session."""

    @property
    def changes(self) -> SessionChanges | None:
        """Changes the session; None until it is there."""

    def steps(self) -> Iterator[StepResult]:
        """Yield the steps, each before `between_steps` gives the session; in the run's thread."""

    def halt(self) -> None:
        """End `steps` soon; from any thread."""

    def between_steps(self) -> AbstractContextManager[Session]:
        """Give the session while no step is taken."""

    def set_margins(self, stop_mm: float, warn_mm: float) -> None:
        """Use these from the next step on; raises `MarginGuardError` and changes nothing."""

    def pace(self) -> float:
        """How fast the source's time goes by, at most 1 as for every clock: 0 while it stands."""


@dataclass(frozen=True, slots=True, eq=False)
class Delivered:
    """A step of ``run``, and when it was ready on the host's clock."""

    run: "Run"
    step: StepResult
    at_ns: int


class Run:
    """Runs ``steps`` until they end, fail or are stopped. ``clock_ns`` does not go back."""

    def __init__(self, steps: Steps, clock_ns: Callable[[], int]) -> None:
        self.steps = steps
        self.failure = ""
        self._fault_seq = 0
        self._on_hold = True
        self._clock_ns = clock_ns
        self._mailbox: LatestValue[Delivered] = LatestValue()
        self._thread = threading.Thread(target=self._run, name="MarginGuard steps", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """Whether no further step will come."""
        return not self._thread.is_alive()

    def newest(self, wait_s: float) -> Delivered | None:
        """The newest step that nobody has taken, waited for at most ``wait_s``.

        The wait is what lets the run's thread work where Qt's event loop keeps the interpreter.
        """
        return self._mailbox.take(wait_s)

    def present_ns(self, last: Delivered) -> int:
        """The present on the clock of the stamps, when ``last`` is the last step that came.

        Time goes on after a run that is over, and after one that another run has replaced: what
        it said becomes stale.
        """
        stands_by = last.run is self and not self.is_over
        pace = self.steps.pace() if stands_by else 1.0
        return last.step.frame.stamp.ns + round(pace * (self._clock_ns() - last.at_ns))

    @property
    def fault_seq(self) -> int:
        """The ``seq`` of the last decision that told of a fault, taken or not; 0 before any."""
        return self._fault_seq

    def stop(self) -> None:
        """End the run, and wait until it has left."""
        self.steps.halt()
        self._thread.join(_JOIN_S)

    def _run(self) -> None:
        try:
            for step in self.steps.steps():
                self._note_fault(step.decision)
                self._mailbox.put(Delivered(self, step, self._clock_ns()))
        except Exception as error:  # whatever it is, the panel says it and the tumour turns grey
            self.failure = one_line(error)

    def _note_fault(self, decision: FixtureDecision) -> None:
        """Between two steps: `Steps.between_steps` waits for it."""
        begins = decision.hold and not self._on_hold
        if begins or decision.state is MarginState.UNKNOWN:
            self._fault_seq = decision.seq
        self._on_hold = decision.hold
