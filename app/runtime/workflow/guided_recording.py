"""What operators record together: its phase, the revision that each has seen, accept and undo."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import StrEnum
from typing import Generic, TypeVar

from app.geometry import InputError

_MAX_UNDO = 50

_Result = TypeVar("_Result")


class Phase(StrEnum):
    """State of a guided recording."""

    IDLE = "idle"
    RECORDING = "recording"
    STOPPED = "stopped"


class GuidedRecording(ABC, Generic[_Result]):
    """Base of a guided calibration or registration, called ``what`` in messages. Thread-safe.

    A change names the revision that its operator has seen, and is refused with `InputError` if
    another operator has changed the recording since. Each recording has another ``_run``. Its
    result stays until the session uses it, because the session may refuse it.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._lock = threading.Lock()
        self._revision = self._run = 0
        self._phase = Phase.IDLE
        self._requested: tuple[_Result | None, _Result] | None = None
        """What the session used at the last request, and what was requested."""
        self._used: list[tuple[_Result | None, _Result]] = []
        """Those requests that the session has met."""

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

    def accept(self, seen: int, use: Callable[[_Result], bool]) -> None:
        """Request by ``use`` that the session uses the result. Raises `InputError` with why not."""
        with self._lock:
            self._check(seen)
            refusal = self._refusal()
            if refusal:
                raise InputError(refusal)
            before, after = self._replacement()
            self._request(use, after)
            self._requested = before, after

    def undo(self, seen: int, use: Callable[[_Result], bool]) -> None:
        """Request by ``use`` what the session used before the result that was accepted last.

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
            self._request(use, before)

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

    def _request(self, use: Callable[[_Result], bool], result: _Result) -> None:
        if not use(result):
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
        self._requested = None
        self._clear()

    @abstractmethod
    def _refusal(self) -> str:
        """Why there is nothing to accept; empty if there is."""

    @abstractmethod
    def _replacement(self) -> tuple[_Result | None, _Result]:
        """What the session uses now, and the result; called if nothing is refused."""

    @abstractmethod
    def _is_in_use(self, result: _Result) -> bool:
        """True if the session uses ``result`` now."""

    @abstractmethod
    def _clear(self) -> None:
        """Drop samples and fit."""
