"""Heartbeat and picture acknowledgements between server and page, beside trame's state."""

from collections.abc import Callable

from wslink import register
from wslink.websocket import LinkProtocol

BEAT = "marginguard.beat"
"""Topic of the heartbeat: a page that does not receive it turns grey."""


class PageLink(LinkProtocol):  # type: ignore[misc]  # wslink has no types
    """Calls ``on_ack(page, number)`` when a page has received picture ``number``."""

    def __init__(self, on_ack: Callable[[str, int], None]) -> None:
        super().__init__()
        self._on_ack = on_ack

    def beat(self, number: int) -> None:
        """Send the heartbeat with the number of the last picture to every page."""
        self.publish(BEAT, {"number": number})

    @register("marginguard.seen")  # type: ignore[untyped-decorator]
    def acknowledge(self, page: str, number: int) -> None:
        """Record that ``page`` has picture ``number``."""
        self._on_ack(str(page), int(number))
