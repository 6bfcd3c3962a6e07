"""Recording that operators share: its phase, the revision that each has seen, accept and undo."""

import logging
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from enum import StrEnum
from typing import Any, Generic, Protocol, TypeVar

from app.geometry import InputError
from app.runtime.compute import Compute
from app.runtime.content import SessionContent
from app.runtime.operator_command import OperatorCommand
from app.session import StepResult

MAX_FAILURES = 3
"""Fits of one recording that may fail by an error of the program; then no further one is begun."""


class GuidedFits:
    """One fit at a time. The thread that shows the results owns it.

    ``compute`` calls ``fit`` in a thread of this object, ``on_computed`` is called from it.
    """

    def __init__(
        self,
        guide: "GuidedRecording[Any]",
        fit: Callable[[Any], Any],
        compute: Compute,
        on_computed: Callable[[], None],
    ) -> None:
        self._guide = guide
        self._fit = fit
        self._compute = compute
        self._on_computed = on_computed
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="guided fit")
        self._computing: tuple[int, Future[Any]] | None = None
        self._failed_run, self._failures = 0, 0

    @property
    def is_done(self) -> bool:
        """True if a result waits for `follow`."""
        return self._computing is not None and self._computing[1].done()

    def follow(self) -> None:
        """Take a result that is done, and begin the next task."""
        if self._computing is not None and self._computing[1].done():
            (run, done), self._computing = self._computing, None
            self._take(run, done)
        task = None if self._computing is not None else self._guide.task()
        if task is None or (task.run == self._failed_run and self._failures >= MAX_FAILURES):
            return
        future = self._worker.submit(self._compute, self._fit, task)
        self._computing = task.run, future
        future.add_done_callback(lambda _: self._on_computed())

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _take(self, run: int, done: "Future[Any]") -> None:
        try:
            self._guide.use_fit(done.result())
        except Exception:
            # Without a fit page and panel go on: they show the session.
            logging.getLogger(__name__).exception("fit of a guided recording")
            self._failures = self._failures + 1 if run == self._failed_run else 1
            self._failed_run = run


_MAX_UNDO = 50

_Result = TypeVar("_Result")
_Value = TypeVar("_Value")


class DisplayOperator(Protocol):
    """Requests of a display to its session, made without waiting for the outcome."""

    def request(self, command: OperatorCommand, /) -> bool:
        """Begin to carry ``command`` out; False while that is not possible."""

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed where it does not delay the display."""


class Phase(StrEnum):
    """State of a guided recording."""

    IDLE = "idle"
    RECORDING = "recording"
    STOPPED = "stopped"


class GuidedRecording(ABC, Generic[_Result]):
    """Base of a guided calibration or registration, called ``what`` in messages. Thread-safe.

    A change names the revision that its operator has seen, and is refused with `InputError` if
    another operator has changed the recording since. Each recording has another ``_run``. Its
    result stays until the session uses it, because the session may refuse it. ``fit`` computes the
    result of a task; ``changed()`` is called in any thread when that is done.
    """

    def __init__(
        self,
        what: str,
        content: SessionContent,
        fit: Callable[[Any], Any],
        operator: DisplayOperator,
        changed: Callable[[], None],
    ) -> None:
        self._what = what
        self._content = content
        self._operator = operator
        self._fits = GuidedFits(self, fit, operator.compute, changed)
        self._lock = threading.Lock()
        self._revision = self._run = 0
        self._phase = Phase.IDLE
        self._fit: Any = None
        """The newest result of this recording; None before the first."""
        self._requested: tuple[_Result | None, _Result] | None = None
        """The result that the session used at the last request, and the requested one."""
        self._used: list[tuple[_Result | None, _Result]] = []
        """Those requests that the session has met."""

    def update(self, content: SessionContent) -> None:
        """Call `use_content`, take a fit that is done, and begin the next one."""
        self.use_content(content)
        self._fits.follow()

    def use_content(self, content: SessionContent) -> None:
        """Use ``content``, that of the session now.

        A recording whose result the session has begun to use ends with it.
        """
        with self._lock:
            self._content = content
            self._follow_session()

    def observe(self, step: StepResult) -> None:
        """Record the poses of ``step`` while there is a recording, in the session's thread."""
        if not self.is_recording:
            return
        with self._lock:
            if self.is_recording:
                self._observe(step)

    def use_fit(self, fit: Any) -> None:
        """Show ``fit``; one of an earlier recording is dropped."""
        with self._lock:
            if fit.run == self._run and self._phase is not Phase.IDLE:
                self._fit = fit

    @property
    def is_recording(self) -> bool:
        """True while samples are recorded."""
        return self._phase is Phase.RECORDING

    @property
    def revision(self) -> object:
        """A value that changes when there is something to show without a new step."""
        return self._revision, self._fits.is_done

    def close(self) -> None:
        """End the thread of the fits."""
        self._fits.close()

    @property
    def can_undo(self) -> bool:
        """True if what the session uses was accepted here and replaced something."""
        with self._lock:
            return self._undoable() is not None

    def stop(self, seen: int) -> None:
        """End the recording; the fit of all its poses follows."""
        with self._lock:
            self._check(seen)
            if self._phase is not Phase.RECORDING:
                raise InputError(f"{self._what}: nothing is recorded; expected a recording")
            self._phase = Phase.STOPPED
            self._revision += 1

    def discard(self, seen: int) -> None:
        """Drop the recording and its result; what the session uses stays."""
        with self._lock:
            self._check(seen)
            self._begin(Phase.IDLE)

    def accept(self, seen: int) -> None:
        """Request that the session uses the result. Raises `InputError` with why not."""
        with self._lock:
            self._check(seen)
            refusal = self._refusal()
            if refusal:
                raise InputError(refusal)
            before, after = self._replacement()
            self._request(after)
            self._requested = before, after

    def undo(self, seen: int) -> None:
        """Request what the session used before the result that was accepted last.

        Raises `InputError` if there is none.
        """
        with self._lock:
            self._check(seen)
            before = self._undoable()
            if before is None:
                raise InputError(
                    f"{self._what}: the one in use did not replace another one here; expected one "
                    "to undo"
                )
            self._request(before)

    def _follow_session(self) -> None:
        """End the recording if the session has begun to use its result. Called with the lock."""
        requested = self._requested
        if requested is not None and self._is_in_use(requested[1]):
            self._used = [*self._used[-_MAX_UNDO + 1 :], requested]
            self._begin(Phase.IDLE)

    def _undoable(self) -> _Result | None:
        # Another program may have replaced it, and one that was undone is no longer in use.
        for before, after in reversed(self._used):
            if self._is_in_use(after):
                return before
        return None

    def _request(self, result: _Result) -> None:
        if not self._operator.request(self._command(result)):
            raise InputError(
                f"{self._what}: the session is not ready for another one; expected the same "
                "request later"
            )

    def _check(self, seen: int) -> None:
        if seen != self._revision:
            raise InputError(
                f"{self._what}: another page has changed it meanwhile, and nothing was done here; "
                "expected the same request again, after a look at it"
            )

    def _begin(self, phase: Phase) -> None:
        """Drop what was recorded, and go on in ``phase``. Called with the lock."""
        self._phase = phase
        self._revision += 1
        self._run += 1
        self._requested = self._fit = None
        self._clear()

    @abstractmethod
    def task(self) -> Any | None:
        """The data to be fitted now; None while there are none."""

    @abstractmethod
    def _observe(self, step: StepResult) -> None:
        """Record the poses of ``step``. Called with the lock."""

    @abstractmethod
    def _command(self, result: _Result) -> OperatorCommand:
        """The command by which the session uses ``result``."""

    @abstractmethod
    def _refusal(self) -> str:
        """The reason why nothing can be accepted; empty if something can."""

    @abstractmethod
    def _replacement(self) -> tuple[_Result | None, _Result]:
        """The result that the session uses now, and the new one; called if nothing is refused."""

    @abstractmethod
    def _is_in_use(self, result: _Result) -> bool:
        """True if the session uses ``result`` now."""

    @abstractmethod
    def _clear(self) -> None:
        """Drop the samples."""
