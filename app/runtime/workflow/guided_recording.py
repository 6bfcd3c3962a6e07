"""What operators record together: its phase, and the revision that each of them has seen."""

import threading
from enum import StrEnum

from app.geometry import InputError


class Phase(StrEnum):
    """State of a guided recording."""

    IDLE = "idle"
    RECORDING = "recording"
    STOPPED = "stopped"


class GuidedRecording:
    """Base of a guided calibration or registration, called ``what`` in messages. Thread-safe.

    A change names the revision that its operator has seen, and is refused with `InputError` if
    another operator has changed the recording since. Each recording has another ``_run``.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self._lock = threading.Lock()
        self._revision = self._run = 0
        self._phase = Phase.IDLE

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
        self._clear()

    def _clear(self) -> None:
        """Drop samples and fit."""
        raise NotImplementedError
