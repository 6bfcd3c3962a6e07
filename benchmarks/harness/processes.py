"""Programs under test and peers as child processes, controlled by lines of JSON."""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

CLI = ("-m", "app.cli")


class ChildError(RuntimeError):
    """The process ended, or did not print an event in time."""


class Child:
    """Process that reads lines of JSON and prints events as lines of JSON; other lines are kept."""

    def __init__(self, name: str, arguments: tuple[str, ...] | list[str], log: Path) -> None:
        self.name = name
        self.log = log
        self.lines: list[str] = []
        self._events: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._printed, self._ended = threading.Condition(), False
        pipe, command = subprocess.PIPE, [sys.executable, *arguments]
        with log.open("a") as errors:
            self.process = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=errors, text=True
            )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    @property
    def rss_mb(self) -> float:
        """Resident memory in MB; 0 if it has ended."""
        return resident_mb(self.process.pid)

    @property
    def cpu_s(self) -> float:
        """User and system time in s (proc(5)); 0 if it has ended."""
        try:
            stat = Path(f"/proc/{self.process.pid}/stat").read_text()
        except OSError:
            return 0.0
        fields = stat.rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def send(self, **command: Any) -> None:
        """Write one line of JSON; raises `ChildError` if the process has ended."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(command) + "\n")
            self.process.stdin.flush()
        except OSError as error:
            raise ChildError(f"{self.name} has ended: {self.tail()}") from error

    def close_input(self) -> None:
        """Close its standard input, the request to end."""
        assert self.process.stdin is not None
        with suppress(OSError):  # unsent input of a killed process
            self.process.stdin.close()

    def expect(self, event: str, timeout_s: float = 30.0) -> dict[str, Any]:
        """Wait for the next event of that kind; skips others. Raises `ChildError`."""
        deadline = time.monotonic() + timeout_s
        while (found := self.poll(max(0.0, deadline - time.monotonic()))) is not None:
            if found["event"] == event:
                return found
        raise ChildError(f"{self.name}: no event {event!r}: {self.tail()}")

    def poll(self, timeout_s: float) -> dict[str, Any] | None:
        """The next event, None if there is none in ``timeout_s``. Raises `ChildError`."""
        try:
            found = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if found["event"] == "end":
            self._events.put(found)
            raise ChildError(f"{self.name} has ended: {self.tail()}")
        return found

    def has_event(self) -> bool:
        """True if an event, or the end of the process, can be read without waiting."""
        return not self._events.empty()

    def line(self, start: str = "", timeout_s: float = 60.0) -> str:
        """The first line with this ``start`` that is no event; waits. Raises `ChildError`."""
        found = self._await(
            lambda: [each for each in self.lines if each.startswith(start)], timeout_s
        )
        return str(found[0])

    def first_output(self, timeout_s: float) -> None:
        """Wait for the first line or event. Raises `ChildError`."""
        self._await(lambda: self.lines or self.has_event(), timeout_s)

    def send_signal(self, number: signal.Signals) -> None:
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
        self.close_input()
        assert self.process.stdout is not None
        self.process.stdout.close()
        return status

    def tail(self) -> str:
        return " | ".join([*self.lines[-1:], *self.log.read_text().splitlines()[-1:]])

    def _await(self, condition: Callable[[], Any], timeout_s: float) -> Any:
        with self._printed:
            self._printed.wait_for(lambda: condition() or self._ended, timeout_s)
            if found := condition():
                return found
        raise ChildError(f"{self.name} has not started: {self.tail()}")

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._printed:
                if line.startswith("{"):
                    self._events.put(json.loads(line))
                else:
                    self.lines.append(line.strip())
                self._printed.notify_all()
        self._events.put({"event": "end"})
        with self._printed:
            self._ended = True
            self._printed.notify_all()


Start = Callable[..., Child]  # starts ``python ARGUMENT...`` under a name, which also names its log


@contextmanager
def children(folder: Path) -> Iterator[tuple[dict[str, Child], Start]]:
    """Running programs by name, and the function that starts one; all end with the context."""
    running: dict[str, Child] = {}

    def start(name: str, *arguments: object) -> Child:
        running[name] = Child(name, [*map(str, arguments)], folder / f"{name}.log")
        return running[name]

    try:
        yield running, start
    finally:
        for child in running.values():
            child.end()


def resident_mb(pid: int | str = "self") -> float:
    """Resident memory of a process in MB, by default of this one; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
