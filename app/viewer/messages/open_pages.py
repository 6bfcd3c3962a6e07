"""The open pages, and the messages to each of them: msgpack below wslink's header."""

import asyncio
import itertools
import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import msgpack
from wslink.chunking import HEADER_LENGTH, generate_chunks

from app.runtime.requests import RateLimit
from app.viewer.address import Role
from app.viewer.messages.checks import MessageError

MAX_MESSAGE_BYTES = 16_384
"""Largest message from a page, with its header. Pages send up to 300 bytes; a long error more."""
_MAX_ITEMS = 64
"""Items of a list or a mapping in a message."""
_MAX_FRAME_BYTES = 4 * 1024 * 1024
"""Larger messages to a page are split."""
_UINT32_BYTES = 4
_ID = re.compile(r"(rpc|system):[A-Za-z0-9]{0,64}:[0-9]{1,16}", re.ASCII)


@dataclass(frozen=True, slots=True)
class Request:
    """A call of ``method`` by a page, whose answer carries ``id``."""

    id: str
    method: str
    args: tuple[Any, ...]


def decode_request(frame: bytes) -> Request:
    """Return the request in a binary frame. Raises `MessageError` for anything else.

    wslink allocates the size that a header claims, up to 4 GB. Here one frame is one message, and a
    header that claims another size is refused.
    """
    if not HEADER_LENGTH < len(frame) <= MAX_MESSAGE_BYTES:
        raise MessageError(
            f"message: {len(frame)} bytes; "
            f"expected more than {HEADER_LENGTH}, at most {MAX_MESSAGE_BYTES}"
        )
    header, content = frame[_UINT32_BYTES:HEADER_LENGTH], frame[HEADER_LENGTH:]
    offset = int.from_bytes(header[:_UINT32_BYTES], "little")
    size = int.from_bytes(header[_UINT32_BYTES:], "little")
    if offset != 0 or size != len(content):
        raise MessageError(
            f"message header: offset {offset}, size {size}; expected 0, {len(content)}"
        )
    return _request(_unpacked(content))


def encode_answer(request_id: str, result: object) -> list[bytes]:
    """Return the frames of an answer to a request."""
    return _frames({"wslink": "1.0", "id": request_id, "result": result})


def encode_error(request_id: str, text: str) -> list[bytes]:
    """Return the frames of an answer that says why a request was refused."""
    return _frames({"wslink": "1.0", "id": request_id, "error": {"code": -32001, "message": text}})


def encode_publication(topic: str, data: object) -> list[bytes]:
    """Return the frames of a message to the subscribers of ``topic``."""
    return _frames({"wslink": "1.0", "id": f"publish:{topic}:0", "result": data})


def _frames(message: dict[str, object]) -> list[bytes]:
    return list(generate_chunks(msgpack.packb(message), _MAX_FRAME_BYTES))


def _unpacked(content: bytes) -> object:
    try:
        return msgpack.unpackb(
            content,
            strict_map_key=True,
            max_array_len=_MAX_ITEMS,
            max_map_len=_MAX_ITEMS,
            max_ext_len=0,
        )
    # Also StackError for deep nesting, UnicodeDecodeError, and OverflowError of a number.
    except (ValueError, msgpack.UnpackException, OverflowError) as error:
        raise MessageError(f"message: {type(error).__name__}; expected msgpack") from error


def _request(message: object) -> Request:
    if not isinstance(message, dict):
        raise MessageError("message: no mapping; expected wslink, id, method, args, kwargs")
    request_id, method, args = (message.get(key) for key in ("id", "method", "args"))
    if not isinstance(request_id, str) or not _ID.fullmatch(request_id):
        raise MessageError("message id: unknown form; expected 'rpc:CLIENT:NUMBER'")
    if not isinstance(method, str) or not isinstance(args, list):
        raise MessageError("message: no method with args; expected text and a list")
    if message.get("kwargs"):
        raise MessageError("message kwargs: not empty; expected none")
    return Request(request_id, method, tuple(args))


MAX_ANSWERS = 64
"""Answers that wait to be sent; a page that has more does not read them."""
STATE_TOPIC = "trame.state.topic"

Frames = list[bytes]


class Outbox:
    """Messages to a page, bounded whatever it reads: of values and pictures only the newest ones.

    One picture is in flight at a time. Until the page has acknowledged it, values and picture that
    follow are held back together, so that a slow page skips steps instead of showing old ones.
    """

    def __init__(self) -> None:
        self._answers: deque[Frames] = deque()
        self._values: dict[str, object] = {}
        self._picture: Frames | None = None
        self._picture_number = 0
        self._others: dict[str, Frames] = {}
        self._sent_number = 0
        self._in_flight = 0

    def answer(self, frames: Frames) -> None:
        """Add the answer to a request. Raises `MessageError` if too many wait."""
        if len(self._answers) >= MAX_ANSWERS:
            raise MessageError(f"answers: {MAX_ANSWERS} are not read; expected fewer")
        self._answers.append(frames)

    def put_values(self, changed: Mapping[str, object]) -> None:
        """Add changed values of the page's state."""
        self._values |= changed

    def put_picture(self, number: int, frames: Frames) -> None:
        """Replace a picture that was not sent yet."""
        self._picture, self._picture_number = frames, number

    def put_other(self, topic: str, frames: Frames) -> None:
        """Replace the message of ``topic`` that was not sent yet."""
        self._others[topic] = frames

    def acknowledge(self, number: int) -> None:
        """Record the last picture that the page has; 0 if it has none and none is on the way.

        Raises `MessageError` for a picture that was never sent.
        """
        if number > self._sent_number:
            raise MessageError(f"picture: {number}; expected at most {self._sent_number}")
        if number in (0, self._in_flight):
            self._in_flight = 0

    def take(self) -> Frames:
        """Remove and return the frames to be sent next; none if there is nothing to send."""
        if self._answers:
            return self._answers.popleft()
        if not self._in_flight and (self._values or self._picture is not None):
            return self._take_shown()
        for topic in self._others:
            return self._others.pop(topic)
        return []

    def _take_shown(self) -> Frames:
        """The changed values, followed by the picture that shows them."""
        values, self._values = self._values, {}
        frames = encode_publication(STATE_TOPIC, values) if values else []
        if self._picture is not None:
            frames += self._picture
            self._picture = None
            self._in_flight = self._sent_number = self._picture_number
        return frames


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
