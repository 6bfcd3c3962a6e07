"""The open pages, and what is published to all of them."""

import asyncio
import itertools
from collections.abc import Callable, Iterator
from typing import Any

from app.runtime.rate_limit import RateLimit
from app.viewer.access.role import Role
from app.viewer.messages.outbox import STATE_TOPIC, Frames, Outbox
from app.viewer.messages.wire import encode_publication

MAX_PAGES = 16
"""Open pages of each role."""
OPENED_PER_S, OPENED_BURST = 5.0, 100.0
"""Pages of each role that are opened: a new page has the whole rate of messages again."""
MESSAGES_PER_S, MESSAGE_BURST = 400.0, 800.0
"""Messages of one page. While its picture is dragged it sends one for each frame of its screen."""
PICTURE_TOPIC = "trame.rca.topic.stream"
BEAT_TOPIC = "marginguard.beat"
"""Topic of the heartbeat: a page that does not receive it turns grey."""


class OpenPage:
    """One connected page. ``id`` is unique in this process; ``greeted`` after its first message."""

    _ids = itertools.count(1)

    def __init__(self, role: Role) -> None:
        self.id = f"page{next(self._ids)}"
        self.role = role
        self.greeted = False
        self.refusals = 0
        self.errors_logged = 0
        self.limit = RateLimit(MESSAGES_PER_S, MESSAGE_BURST)
        self.outbox = Outbox()
        self.to_send = asyncio.Event()
        self._pong: bytes | None = None

    def answer(self, frames: Frames) -> None:
        """Send the answer to a request."""
        self.outbox.answer(frames)
        self.to_send.set()

    def acknowledge(self, number: int) -> None:
        """Record that the page has picture ``number``."""
        self.outbox.acknowledge(number)
        self.to_send.set()

    def pong(self, data: bytes) -> None:
        """Answer a ping; only the last one that waits is answered, as the protocol permits."""
        self._pong = data
        self.to_send.set()

    def take_pong(self) -> bytes | None:
        """Remove and return the data of the ping to be answered."""
        data, self._pong = self._pong, None
        return data


class OpenPages:
    """The pages that are connected now. All calls come from the page's thread.

    ``on_gone(id)`` is called when a page is no longer connected.
    """

    def __init__(self, on_gone: Callable[[str], None] | None = None) -> None:
        self._on_gone = on_gone
        self._pages: dict[str, OpenPage] = {}
        self._opened = {role: RateLimit(OPENED_PER_S, OPENED_BURST) for role in Role}

    def __iter__(self) -> Iterator[OpenPage]:
        return iter(tuple(self._pages.values()))

    def has_room(self, role: Role, now_ns: int) -> bool:
        """True if another page of ``role`` may be opened; it counts as opened."""
        is_few = sum(page.role is role for page in self._pages.values()) < MAX_PAGES
        return is_few and self._opened[role].take(now_ns)

    def add(self, page: OpenPage) -> None:
        """Publish to ``page`` from now on."""
        self._pages[page.id] = page

    def remove(self, page: OpenPage) -> None:
        """Publish to ``page`` no longer."""
        self._pages.pop(page.id, None)
        if self._on_gone is not None:
            self._on_gone(page.id)

    def beat(self, number: int) -> None:
        """Send the heartbeat with the number of the last picture."""
        self.publish(BEAT_TOPIC, {"number": number})

    def publish(self, topic: str, data: Any, **_: object) -> None:
        """Send ``data`` to the subscribers of ``topic`` on all pages; trame's `publish`."""
        greeted = [page for page in self if page.greeted]
        frames = encode_publication(topic, data) if greeted and topic != STATE_TOPIC else []
        for page in greeted:
            if topic == STATE_TOPIC:
                page.outbox.put_values(data)
            elif topic == PICTURE_TOPIC:
                page.outbox.put_picture(data["meta"]["number"], frames)
            else:
                page.outbox.put_other(topic, frames)
            page.to_send.set()
