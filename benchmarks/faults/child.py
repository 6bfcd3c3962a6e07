"""A program under test or a peer, controlled by lines of JSON."""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any


class ChildError(RuntimeError):
    """The process ended, or did not print an event in time."""


class GuardStartError(RuntimeError):
    """The program under test does not start, so that no row can be measured."""


class Child:
    """Process that reads lines of JSON and prints events as lines of JSON; other lines are kept."""

    def __init__(self, name: str, arguments: Sequence[str], log: Path) -> None:
        self.name = name
        self.log = log
        self.lines: list[str] = []
        self._events: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        with log.open("a") as errors:
            self.process = subprocess.Popen(
                [sys.executable, *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env=dict(os.environ),
            )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        """False if the process has ended."""
        return self.process.poll() is None

    def send(self, **command: Any) -> None:
        """Write one line of JSON; raises `ChildError` if the process has ended."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(command) + "\n")
            self.process.stdin.flush()
        except OSError as error:
            raise ChildError(f"{self.name} has ended: {self.tail()}") from error

    def expect(self, event: str, timeout_s: float = 30.0) -> dict[str, Any]:
        """Wait for the next event of that kind; skips others. Raises `ChildError`."""
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                found = self._events.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise ChildError(f"{self.name}: no event {event!r}: {self.tail()}") from None
            if found["event"] == event:
                return found
            if found["event"] == "end":
                raise ChildError(f"{self.name} ended before {event!r}: {self.tail()}")

    def poll(self, timeout_s: float) -> dict[str, Any] | None:
        """The next event, None if there is none in ``timeout_s``. Raises `ChildError`."""
        try:
            found = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if found["event"] == "end":
            raise ChildError(f"{self.name} ended: {self.tail()}")
        return found

    @property
    def has_output(self) -> bool:
        """True if the process has printed a line, or an event that waits."""
        return bool(self.lines) or not self._events.empty()

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal, if the process runs."""
        if self.running:
            self.process.send_signal(number)

    def end(self, number: signal.Signals = signal.SIGTERM, timeout_s: float = 15.0) -> int:
        """End the process by a signal, SIGKILL after ``timeout_s``; return its exit status."""
        self.send_signal(number)
        try:
            status = self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            status = self.process.wait()
        self._reader.join()
        for stream in (self.process.stdin, self.process.stdout):
            assert stream is not None
            with suppress(OSError):  # unsent input of a killed process
                stream.close()
        return status

    def tail(self) -> str:
        """The last lines of output and log."""
        return " | ".join([*self.lines[-1:], *self.log.read_text().splitlines()[-1:]])

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith("{"):
                self._events.put(json.loads(line))
            else:
                self.lines.append(line.strip())
        self._events.put({"event": "end"})
