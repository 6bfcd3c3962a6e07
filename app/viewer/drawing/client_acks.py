"""Acknowledgements of pictures: the next picture waits until a client has the last one."""

from app.geometry import NS_PER_S

_TIMEOUT_NS = NS_PER_S
"""A client that is silent, or has not received a picture, for so long is not waited for."""


class ClientAcks:
    """Tracks which client has which picture. Times are those of one steady clock, in ns.

    A client acknowledges its last picture with each picture and with each heartbeat. It sends 0
    before its first picture, when no picture is on the way to it.
    """

    def __init__(self) -> None:
        self._last_sent = 0
        self._sent_ns = 0
        self._acks: dict[str, tuple[int, int]] = {}
        """Per client: its last picture, and the time of the acknowledgement."""

    def sent(self, number: int, now_ns: int) -> None:
        """Record that picture ``number`` was sent to all clients."""
        self._last_sent, self._sent_ns = number, now_ns

    def acknowledge(self, client: str, number: int, now_ns: int) -> None:
        """Record that picture ``number`` is the last one that ``client`` has; 0 for none."""
        self._acks[client] = (number or self._last_sent, now_ns)

    def any_active(self, now_ns: int) -> bool:
        """True if a client has sent an acknowledgement within the timeout."""
        self._acks = {
            client: (number, at_ns)
            for client, (number, at_ns) in self._acks.items()
            if now_ns - at_ns <= _TIMEOUT_NS
        }
        return bool(self._acks)

    def is_pending(self, now_ns: int) -> bool:
        """True while no active client has acknowledged the last picture; one of them is enough."""
        if not self.any_active(now_ns) or now_ns - self._sent_ns > _TIMEOUT_NS:
            return False
        return all(number < self._last_sent for number, _ in self._acks.values())
