"""Which of the open pages have the last picture: no other is sent before."""

from app.geometry import NS_PER_S

_GIVEN_UP_NS = NS_PER_S
"""A page that says nothing, or has not got a picture, for so long is not waited for."""


class Pages:
    """Counts pictures out and in again, by page. Times are those of one steady clock, in ns.

    A page says at each heartbeat, and at each picture, which picture was its last: 0 before its
    first one, when nothing is on its way to it that it could wait for.
    """

    def __init__(self) -> None:
        self._last_sent = 0
        self._sent_ns = 0
        self._has: dict[str, tuple[int, int]] = {}
        """A page's last picture, and when it said so."""

    def sent(self, number: int, now_ns: int) -> None:
        """Picture ``number`` is on its way to every page."""
        self._last_sent, self._sent_ns = number, now_ns

    def has(self, page: str, number: int, now_ns: int) -> None:
        """``page`` says that picture ``number`` is its last."""
        self._has[page] = (number or self._last_sent, now_ns)

    def any_awake(self, now_ns: int) -> bool:
        """Whether there is a page that says something."""
        self._has = {
            page: (number, at_ns)
            for page, (number, at_ns) in self._has.items()
            if now_ns - at_ns <= _GIVEN_UP_NS
        }
        return bool(self._has)

    def waiting(self, now_ns: int) -> bool:
        """Whether the last picture is on its way to a page that is awake."""
        if not self.any_awake(now_ns) or now_ns - self._sent_ns > _GIVEN_UP_NS:
            return False
        return any(number < self._last_sent for number, _ in self._has.values())
