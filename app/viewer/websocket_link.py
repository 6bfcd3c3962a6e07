"""What page and server say to each other beside trame's state: signs of life, and receipts."""

from collections.abc import Callable

from wslink import register
from wslink.websocket import LinkProtocol

BEAT = "marginguard.beat"
"""Topic of the heartbeat: a page that does not hear it turns grey."""


class PageLink(LinkProtocol):  # type: ignore[misc]  # wslink has no types
    """``on_seen(page, number)`` is told when a page has a picture."""

    def __init__(self, on_seen: Callable[[str, int], None]) -> None:
        super().__init__()
        self._on_seen = on_seen

    def beat(self, number: int) -> None:
        """Tell every page that the server lives, and which picture was the last."""
        self.publish(BEAT, {"number": number})

    @register("marginguard.seen")  # type: ignore[untyped-decorator]
    def seen(self, page: str, number: int) -> None:
        """A page has picture ``number``."""
        self._on_seen(str(page), int(number))
