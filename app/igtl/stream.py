"""Messages out of the pieces in which a socket hands them over."""

from collections import Counter
from collections.abc import Collection

from app.igtl.errors import IgtlError, IgtlLimitError
from app.igtl.wire import (
    HEADER_BYTES,
    MOST_BODY_BYTES,
    Header,
    Message,
    read_header,
    read_message,
)

_MOST_WORDS = 200


class Refusals:
    """What was left out, counted by the kind of error, and the latest one in words."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.last = ""

    def add(self, error: Exception) -> None:
        """Count ``error``; its words are cut, since they may quote what a stranger sent."""
        self.counts[type(error).__name__] += 1
        self.last = str(error)[:_MOST_WORDS]


class MessageStream:
    """``stream.feed(piece)`` gives the messages of the wanted ``types`` that are now complete.

    The bodies of others, and of those above `MOST_BODY_BYTES`, pass without being kept: what is
    held is one body and one piece at most. ``complete`` counts all that have passed. A body that
    is no good goes to ``refusals``; a header that is none raises `IgtlFramingError`, and the
    stream is of no more use.
    """

    def __init__(self, types: Collection[str], refusals: Refusals) -> None:
        self.complete = 0
        self.ignored = 0
        self._types = types
        self._refusals = refusals
        self._held = bytearray()
        self._header: Header | None = None
        self._to_skip = 0

    def feed(self, piece: bytes) -> list[Message]:
        """Take the next piece in, however the sender's messages were cut."""
        self._held += piece
        messages: list[Message] = []
        while self._advance(messages):
            pass
        return messages

    def _advance(self, messages: list[Message]) -> bool:
        if self._to_skip:
            skipped = min(self._to_skip, len(self._held))
            del self._held[:skipped]
            self._to_skip -= skipped
            self.complete += not self._to_skip
            return not self._to_skip and bool(self._held)
        if self._header is None:
            if len(self._held) < HEADER_BYTES:
                return False
            self._begin(read_header(self._take(HEADER_BYTES)))
            return True
        if len(self._held) < self._header.body_bytes:
            return False
        header, self._header = self._header, None
        self.complete += 1
        try:
            messages.append(read_message(header, self._take(header.body_bytes)))
        except IgtlError as error:
            self._refusals.add(error)
        return True

    def _begin(self, header: Header) -> None:
        if header.type in self._types and header.body_bytes <= MOST_BODY_BYTES:
            self._header = header
            return
        self._to_skip = header.body_bytes
        self.complete += not header.body_bytes
        if header.type in self._types:
            self._refusals.add(
                IgtlLimitError(
                    f"{header.type} has a body of {header.body_bytes} bytes: "
                    f"{MOST_BODY_BYTES} allowed"
                )
            )
        else:
            self.ignored += 1

    def _take(self, count: int) -> bytes:
        taken = bytes(self._held[:count])
        del self._held[:count]
        return taken
