"""Timing of the alarm: it sounds while the tool is in the tumour."""

from app.fixture import MarginState

REPEAT_NS = 1_000_000_000
"""Time between two sounds of one breach."""


class Alarm:
    """Due at once when a breach begins, and every `REPEAT_NS` while it lasts; never while muted."""

    def __init__(self) -> None:
        self.muted = False
        self._last_ns: int | None = None

    def due(self, state: MarginState, now_ns: int) -> bool:
        """Return True if the alarm has to sound now; ``now_ns`` is of a steady clock."""
        if state is not MarginState.POSITIVE:
            self._last_ns = None
            return False
        if self.muted or (self._last_ns is not None and now_ns - self._last_ns < REPEAT_NS):
            return False
        self._last_ns = now_ns
        return True
