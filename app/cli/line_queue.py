"""Write lines from a thread of their own: a reader that stops reading delays no step."""

import os
import queue
import threading
from typing import TextIO

MAX_LINES = 1000
"""Lines that may wait for the reader; later ones are dropped and counted."""

_CLOSE_S = 1.0


class LineQueue:
    """Writes lines to ``stream`` in their order.

    `put` returns at once. When `MAX_LINES` lines wait for a reader, it drops the new one and counts
    it in ``dropped``. An error of the stream, such as `BrokenPipeError`, is raised by the next
    `put` and by `close`.
    """

    def __init__(self, stream: TextIO, max_lines: int = MAX_LINES) -> None:
        self.dropped = 0
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(max_lines)
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._work, name="lines", daemon=True)
        self._thread.start()

    def put(self, line: str) -> bool:
        """Write ``line`` soon; False if it was dropped."""
        self._raise_error()
        try:
            self._lines.put_nowait(line)
        except queue.Full:
            self.dropped += 1
            return False
        return True

    def close(self) -> None:
        """Wait until the reader has taken all lines, 1 s at most; the rest is lost."""
        try:
            self._lines.put(None, timeout=_CLOSE_S)
        except queue.Full:
            return
        self._thread.join(_CLOSE_S)
        self._raise_error()

    def _raise_error(self) -> None:
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def _work(self) -> None:
        try:
            while (line := self._lines.get()) is not None:
                self._write(f"{line}\n")
        except OSError as error:
            self._error = error

    def _write(self, text: str) -> None:
        """Write all of ``text`` past the buffer of the stream.

        A thread that waits for a reader would keep the buffer's lock, for which the interpreter
        waits at its end.
        """
        try:
            descriptor = self._stream.fileno()
        except (OSError, ValueError):  # a stream in memory
            self._stream.write(text)
            return
        encoding = self._stream.encoding or "utf-8"
        left = memoryview(text.encode(encoding, self._stream.errors or "strict"))
        while left:
            left = left[os.write(descriptor, left) :]
