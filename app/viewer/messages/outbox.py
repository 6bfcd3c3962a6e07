"""Messages to be sent to one page."""

from collections import deque
from collections.abc import Mapping

from app.viewer.messages.errors import MessageError
from app.viewer.messages.wire import encode_publication

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
