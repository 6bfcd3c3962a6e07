"""Exponential backoff between connection attempts."""

from app.igtl.errors import IgtlError


class Backoff:
    """Delay that starts at ``first_s``, doubles each time and is limited to ``max_s``."""

    def __init__(self, first_s: float = 0.25, max_s: float = 5.0) -> None:
        if not 0.0 < first_s <= max_s:
            raise IgtlError(
                f"backoff delays are {first_s} s to {max_s} s; expected 0 < first_s <= max_s"
            )
        self._first_s = first_s
        self._max_s = max_s
        self._next_s = first_s

    def next_s(self) -> float:
        """Return the current delay and double it for the next call."""
        delay_s = self._next_s
        self._next_s = min(2.0 * delay_s, self._max_s)
        return delay_s

    def reset(self) -> None:
        """Start again at ``first_s``, after a successful attempt."""
        self._next_s = self._first_s
