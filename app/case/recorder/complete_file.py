"""An output for the MCAP writer that is a complete MCAP file after each flush."""

import os
import struct
from contextlib import suppress
from pathlib import Path

_TAIL = (
    struct.pack("<BQI", 0x0F, 4, 0)  # DataEnd without a CRC
    + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)  # Footer: no summary section, no CRC
    + b"\x89MCAP0\r\n"
)
"""Ends a file without an index. The next flush replaces it."""


class CompleteFile:
    """Collects what `mcap.writer.Writer` writes, and appends it to a new file at each `flush`.

    Each flush is one system call and ends with a footer, so that the file is valid, without an
    index, whenever the process is killed. `finish` writes without that footer: the writer has
    written its own. Raises `OSError`.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        self._pending = bytearray()
        self._written = 0
        self.closed = False

    def write(self, data: bytes) -> int:
        """Collect ``data`` until the next flush."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Position in the file of the next byte."""
        return self._written + len(self._pending)

    def flush(self) -> None:
        """Pass everything to the operating system, so that it survives this process."""
        self._append(_TAIL)

    def finish(self) -> None:
        """Write the last bytes, which end the file."""
        self._append(b"")

    def sync(self) -> None:
        """Write the file to the disk; may be called from a thread beside `write`."""
        os.fsync(self._descriptor)

    def close(self) -> None:
        """Close the file without a flush; a second call does nothing."""
        if not self.closed:
            self.closed = True
            os.close(self._descriptor)

    def _append(self, tail: bytes) -> None:
        if not self._pending:
            return
        data = memoryview(bytes(self._pending) + tail)
        at = 0
        try:
            while at < len(data):
                at += os.pwrite(self._descriptor, data[at:], self._written + at)
        except OSError:
            self._remove_partial()
            raise
        self._written += len(self._pending)
        self._pending.clear()

    def _remove_partial(self) -> None:
        """End the file as before a write that failed; its blocks exist, so no space is needed."""
        with suppress(OSError):
            os.ftruncate(self._descriptor, self._written)
            os.pwrite(self._descriptor, _TAIL, self._written)
