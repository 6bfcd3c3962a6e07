"""A terminal of a reader: shell blocks in one environment, with their output as it arrives."""

import os
import re
import signal
import subprocess
import threading
from pathlib import Path

TIMEOUT_S = 150.0
"""Longest wait for an event; a page that works needs a fraction of it."""

DEFAULT_SIGINT = ("env", "--default-signal=INT")
"""Begin of a command: a process that was started with ``&`` in a shell ignores Ctrl-C."""

ENDED_BY_SIGINT = (0, -signal.SIGINT, 128 + signal.SIGINT)

# The state of the shell is kept as a reader's terminal keeps it.
SCRIPT = """set -eo pipefail
keep() { env -0 > "$BLOCK_STATE/new" && mv "$BLOCK_STATE/new" "$BLOCK_STATE/env"; }
trap 'status=$?; keep; exit $status' EXIT
source "$BLOCK_STATE/block.sh"
"""


class Terminal:
    """Executes one shell block after the other; at most one runs at a time."""

    def __init__(self, folder: Path, state: Path, environment: dict[str, str]) -> None:
        self.output = ""
        self._folder = folder
        self._state = state
        self.environment = environment
        self._process: subprocess.Popen[str] | None = None
        self._arrived = threading.Condition()
        self._reader: threading.Thread | None = None
        self._ended = False
        state.mkdir()

    def start(self, block: str) -> None:
        """Start a block; the output before it is forgotten."""
        self.interrupt()
        (self._state / "block.sh").write_text(block, encoding="utf-8")
        self.output = ""
        self._ended = False
        self._process = subprocess.Popen(
            [*DEFAULT_SIGINT, "bash", "-c", SCRIPT],
            cwd=self._folder,
            env={**self.environment, "BLOCK_STATE": str(self._state)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, args=(self._process,), daemon=True)
        self._reader.start()

    def finish(self) -> int:
        """Wait until the running block ends; return its exit status."""
        assert self._process is not None
        assert self._reader is not None
        process, self._process = self._process, None
        try:
            process.wait(TIMEOUT_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise AssertionError(f"still running after {TIMEOUT_S} s:\n{self.output}") from None
        self._reader.join(TIMEOUT_S)
        self._keep_state()
        return process.returncode

    def wait_for(self, pattern: re.Pattern[str]) -> None:
        """Wait until the output contains ``pattern``; fail if the block ends without it."""
        with self._arrived:
            self._arrived.wait_for(
                lambda: pattern.search(self.output) or self._ended, timeout=TIMEOUT_S
            )
        assert pattern.search(self.output), f"not printed: {pattern.pattern}\n{self.output}"

    def interrupt(self) -> None:
        """Press Ctrl-C if a block is running, and require that it ends."""
        if self._process is None:
            return
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGINT)
        status = self.finish()
        assert status in ENDED_BY_SIGINT, f"status {status} after Ctrl-C:\n{self.output}"

    def kill(self) -> None:
        """End a running block at once; for the end of a test that failed."""
        if self._process is not None:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None

    def _read(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        for line in process.stdout:
            with self._arrived:
                self.output += line
                self._arrived.notify_all()
        with self._arrived:
            self._ended = True
            self._arrived.notify_all()

    def _keep_state(self) -> None:
        """Adopt the working directory and the variables that the block left."""
        variables = self._state / "env"
        if variables.exists():  # not if Ctrl-C arrived while they were written
            pairs = variables.read_text().rstrip("\0").split("\0")
            self.environment = dict(pair.split("=", 1) for pair in pairs)
            self._folder = Path(self.environment["PWD"])
            variables.unlink()
