"""Other processes of a test: controlled by lines, and receivers of messages. All are forked."""

import json
import os
import re
import select
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests.forking import parent_of

DEADLINE_S = 90.0
"""Timeout of a wait; none takes more than a few seconds if it succeeds."""

LEAVING_S = 0.5
"""After it a peer that does not react to SIGTERM is killed."""

LOCAL_TIME = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]+[+-]\d\d:\d\d ")


class Child:
    """Process that is controlled by lines; a wait for it fails the test after `DEADLINE_S`."""

    def __init__(
        self, arguments: Sequence[object], log: Path, environment: Mapping[str, str] | None = None
    ) -> None:
        self.log = log
        texts = [str(each) for each in arguments]
        with log.open("w") as errors:
            self.process = parent_of(texts).start(
                texts, stderr=errors.fileno(), environment=environment
            )
        self._output = b""
        self._is_command = texts[0] in ("-m", "-c")

    def line(self, accept: Callable[[str], bool] = lambda line: True) -> str:
        """Wait for the next line that ``accept`` accepts; skip the lines before it.

        The local time that begins a line of a live session is removed.
        """
        skipped = []
        for printed in self.lines():
            line = LOCAL_TIME.sub("", printed)
            if accept(line):
                return line.strip()
            skipped.append(line)
        return self.fail(f"no such line among {''.join(skipped)!r}")

    def lines(self) -> Iterator[str]:
        """Yield the lines that the process prints until it closes its output."""
        while line := self._line():
            yield line

    def send(self, line: str) -> None:
        """Write a line to the standard input of the process."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def ask(self, request: Any) -> Any:
        """Send a line of JSON, and return the line of JSON that answers it."""
        self.send(json.dumps(request))
        return json.loads(self.line())

    def end_input(self) -> None:
        """Close the standard input of the process."""
        with suppress(BrokenPipeError):
            self.process.stdin.close()

    def wait(self) -> int:
        """Wait for the exit and return the exit status."""
        try:
            return self.process.wait(DEADLINE_S)
        except TimeoutError:
            return self.fail("it does not end")

    def end(self, number: int) -> int:
        """Send the signal ``number``, wait for the exit and return the exit status."""
        self.process.send_signal(number)
        return self.wait()

    def stop(self, number: int = signal.SIGINT) -> str:
        """End a command by a signal, which is no error of it; return its log."""
        assert self.end(number) == 128 + number
        log = self.log.read_text()
        return self.fail("its log has an error") if "Traceback" in log else log

    @contextmanager
    def held(self) -> Iterator[None]:
        """Suspend the process in the ``with`` block."""
        self.process.send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            self.process.send_signal(signal.SIGCONT)

    def fail(self, what: str) -> Any:
        """Fail the test with the log of the process."""
        status = self.process.poll()
        pytest.fail(f"{what}; status {status}, {self.log.read_text()!r}")

    def close(self) -> None:
        """End the process; a peer leaves the graph, so that no publisher waits for it."""
        if not self._is_command:
            self.end_input()
            self.process.terminate()
            with suppress(TimeoutError):
                self.process.wait(LEAVING_S)
        self.process.kill()
        self.process.wait()
        self.process.close()

    def _line(self) -> str:
        """The next line; empty at the end of the output."""
        output = self.process.stdout
        assert output is not None
        end_s, searched = time.monotonic() + DEADLINE_S, 0
        while (end := self._output.find(b"\n", searched)) < 0:
            searched = len(self._output)
            if not select.select([output], [], [], max(0.0, end_s - time.monotonic()))[0]:
                self.fail(f"no further line in {DEADLINE_S:g} s")
            data = os.read(output.fileno(), 1 << 16)
            if not data:
                end = len(self._output) - 1
                break
            self._output += data
        line, self._output = self._output[: end + 1], self._output[end + 1 :]
        return line.decode()


class Receiver(Child):
    """Process that prints ``ready`` and each message that it receives as a line of JSON."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._early: list[str] = []

    def wait_until_ready(self) -> None:
        """Wait until the process has discovered a publisher for each of its topics."""
        for line in self.lines():
            if line == "ready\n":
                return
            self._early.append(line)  # latched, received before the other publishers were found
        self.fail("the receiving process found no publisher")

    def take(self, count: int) -> list[dict[str, Any]]:
        """Wait for the next ``count`` messages."""
        return [json.loads(self._message()) for _ in range(count)]

    def until(self, accept: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait for the first message that ``accept`` accepts."""
        while not accept(message := self.take(1)[0]["message"]):
            pass
        return message

    def messages(self) -> list[dict[str, Any]]:
        """All further messages until the process has received its counts and exits."""
        lines = [*self._early, *(line for line in self.lines() if line != "ready\n")]
        self._early = []
        if self.wait() != 0:
            self.fail("the receiving process did not get all messages")
        return [json.loads(line) for line in lines]

    def _message(self) -> str:
        if self._early:
            return self._early.pop(0)
        while (line := self._line()) == "ready\n":
            pass
        return line or self.fail("no further message")
