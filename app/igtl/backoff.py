"""How long to wait before the next attempt."""

from app.igtl.errors import IgtlError


class Backoff:
    """``first_s``, then twice as long each time, ``most_s`` at most; `reset` begins anew."""

    def __init__(self, first_s: float = 0.25, most_s: float = 5.0) -> None:
        if not 0.0 < first_s <= most_s:
            raise IgtlError(f"waits of {first_s} s to {most_s} s: 0 < first <= most wanted")
        self._first_s = first_s
        self._most_s = most_s
        self._next_s = first_s

    def next_s(self) -> float:
        """The wait that is due now; the next one is twice as long."""
        wait_s = self._next_s
        self._next_s = min(2.0 * wait_s, self._most_s)
        return wait_s

    def reset(self) -> None:
        """What was tried has worked."""
        self._next_s = self._first_s
