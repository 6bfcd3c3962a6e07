"""The live node that a display has started: a process of its own, which guards on its own."""

import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from signal import SIGINT

from app.bridge.ros_errors import BridgeError
from app.files.paths import state_folder

_ERROR = "marginguard: error: "
_STOP_S = 30.0
_READ_CHARS = 65_536
_LOOK_S, _JOIN_S = 0.1, 1.0


class LiveChild:
    """``marginguard live`` with ``arguments``, started by a display.

    `close` ends it in an orderly way. It does not end with its display: a guard whose display was
    killed goes on until it gets a SIGINT or SIGTERM. It is not in the terminal's group, so Ctrl-C
    reaches the display alone. It writes its log to a file, because a pipe that a stalled display
    does not read would stall the guard, too. ``said(line)`` gets each line of it, in a thread.
    """

    def __init__(self, arguments: Sequence[str], said: Callable[[str], None]) -> None:
        self._said = said
        self._last = ""
        folder = state_folder() / "live_node"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(".log", "", folder)
        self.log = Path(name)
        with os.fdopen(descriptor, "wb") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "app.cli", "live", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, name="live node's log", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The process."""
        return self._process.pid

    @property
    def ended(self) -> str:
        """That it has ended by itself, and by which error; empty while it runs."""
        status = self._process.poll()
        if status is None:
            return ""
        self._reader.join(_JOIN_S)
        reported = self._reported()
        return f"the live node has ended with status {status}{reported and ': '}{reported}"

    @property
    def error(self) -> str:
        """The error that ended it; else as `ended`."""
        ended = self.ended  # then its last line is known
        return self._reported() or ended

    def _reported(self) -> str:
        return self._last.removeprefix(_ERROR) if self._last.startswith(_ERROR) else ""

    def stop(self) -> None:
        """Ask it to end."""
        if self._process.poll() is None:
            self._process.send_signal(SIGINT)

    def close(self) -> None:
        """End it and wait for its end, which half a minute must be enough for; remove its log."""
        self.stop()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired as error:
            raise BridgeError(
                f"live node {self.pid}: still runs {_STOP_S:g} s after SIGINT; expected it to end: "
                f"see {self.log}"
            ) from error
        self._reader.join()
        self.log.unlink(missing_ok=True)

    def _read(self) -> None:
        text, is_over = "", False
        with self.log.open(errors="replace") as log:
            while not is_over:
                is_over = self._process.poll() is not None  # before the last lines are read
                while part := log.read(_READ_CHARS):
                    *lines, text = (text + part).split("\n")
                    self._say(lines)
                if not is_over:
                    threading.Event().wait(_LOOK_S)
        self._say([text])

    def _say(self, lines: Sequence[str]) -> None:
        for line in lines:
            if line.strip():
                self._last = line.strip()
                self._said(line)
