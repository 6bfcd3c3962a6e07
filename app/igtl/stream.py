"""Split the byte stream of a socket into messages; `source` says why not by pyigtl."""

from collections import Counter
from collections.abc import Callable, Collection, Mapping

from app.igtl.errors import IgtlError, IgtlLimitError
from app.igtl.wire import (
    HEADER_BYTES,
    MAX_BODY_BYTES,
    Header,
    Message,
    read_header,
    read_message,
)

_MAX_CHARS = 200


class Refusals:
    """Counts refused messages by type of error and keeps the latest error message."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.last = ""

    def add(self, error: Exception) -> None:
        """Count ``error``; its message is truncated because it may quote network data."""
        self.counts[type(error).__name__] += 1
        self.last = str(error)[:_MAX_CHARS]


Unread = Callable[[Header, bytes], None]
"""Takes a complete message as it came, with its checksum not yet verified."""


class MessageStream:
    """``stream.feed(data)`` returns the messages of ``types`` that are now complete.

    ``unread`` are functions by type, each with a limit of its own for the body: they take those
    messages as they came, so that another thread can read them. Bodies of other types and bodies
    above ``max_body_bytes`` are skipped without being stored, so the buffer holds one body and one
    chunk of data at most. ``complete`` counts all messages that
    have passed. Invalid bodies are added to ``refusals``. An invalid header raises
    `IgtlFramingError`; the stream cannot be used afterwards.
    """

    def __init__(
        self,
        types: Collection[str],
        refusals: Refusals,
        max_body_bytes: int = MAX_BODY_BYTES,
        unread: Mapping[str, tuple[Unread, int]] | None = None,
    ) -> None:
        self._unread = unread or {}
        self.complete = 0
        self.ignored = 0
        self._max_bytes = {
            **dict.fromkeys(types, max_body_bytes),
            **{kind: limit for kind, (_, limit) in self._unread.items()},
        }
        self._refusals = refusals
        self._buffer = bytearray()
        self._header: Header | None = None
        self._to_skip = 0

    def feed(self, data: bytes) -> list[Message]:
        """Add received bytes, of any length, and return the complete messages."""
        self._buffer += data
        messages: list[Message] = []
        while self._advance(messages):
            pass
        return messages

    def _advance(self, messages: list[Message]) -> bool:
        if self._to_skip:
            skipped = min(self._to_skip, len(self._buffer))
            del self._buffer[:skipped]
            self._to_skip -= skipped
            self.complete += not self._to_skip
            return not self._to_skip and bool(self._buffer)
        if self._header is None:
            if len(self._buffer) < HEADER_BYTES:
                return False
            self._begin(read_header(self._take(HEADER_BYTES)))
            return True
        if len(self._buffer) < self._header.body_bytes:
            return False
        header, self._header = self._header, None
        self.complete += 1
        if header.type in self._unread:
            self._unread[header.type][0](header, self._take(header.body_bytes))
            return True
        try:
            messages.append(read_message(header, self._take(header.body_bytes)))
        except IgtlError as error:
            self._refusals.add(error)
        return True

    def _begin(self, header: Header) -> None:
        max_bytes = self._max_bytes.get(header.type)
        if max_bytes is not None and header.body_bytes <= max_bytes:
            self._header = header
            return
        self._to_skip = header.body_bytes
        self.complete += not header.body_bytes
        if max_bytes is not None:
            self._refusals.add(
                IgtlLimitError(
                    f"{header.type} has a body of {header.body_bytes} bytes; "
                    f"expected at most {max_bytes}"
                )
            )
        else:
            self.ignored += 1

    def _take(self, count: int) -> bytes:
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken
