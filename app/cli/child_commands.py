"""Run commands as children of another one: ``python -m app.cli.child_commands PID COMMAND ...``.

A child ends with its parent: on Linux the system sends it SIGTERM when the parent has died, also by
SIGKILL.
"""

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

from app.geometry import InputError

END_TIMEOUT_S = 15.0
"""Time in which a command ends after SIGINT; then it is killed."""

_PR_SET_PDEATHSIG = 1


def child_of_command(*arguments: str) -> list[str]:
    """The command line of ``marginguard ARGUMENTS`` as a child of this process."""
    return [sys.executable, "-m", "app.cli.child_commands", str(os.getpid()), *arguments]


def end_with_parent(parent: int) -> None:
    """Request SIGTERM for the death of ``parent``; exit at once if it has died already."""
    if not sys.platform.startswith("linux"):
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        sys.exit(128 + signal.SIGTERM)


class CommandGroup:
    """``with CommandGroup(ended) as group: group.start("live", "--config", FILE)``.

    Standard output of a command is printed with its name before each line. ``ended(name, status)``
    is called, in a thread of its own, when one ends by itself. On exit all get one SIGINT, and
    SIGKILL after `END_TIMEOUT_S`. They are in sessions of their own, so that the SIGINT of a
    terminal reaches them once, from here.
    """

    def __init__(self, ended: Callable[[str, int], None]) -> None:
        self._ended = ended
        self._children: list[tuple[str, subprocess.Popen[str], threading.Thread]] = []
        self._ready: dict[str, threading.Event] = {}
        self._closing = threading.Event()

    def start(self, command: str, *arguments: str) -> None:
        """Start ``marginguard COMMAND ARGUMENTS``."""
        process = subprocess.Popen(
            child_of_command(command, *arguments),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._ready[command] = threading.Event()
        reader = threading.Thread(
            target=self._read, args=(command, process), name=f"output of {command}", daemon=True
        )
        self._children.append((command, process, reader))
        reader.start()

    def wait_until_ready(self, stop: threading.Event) -> None:
        """Wait until each command has printed its first line, or ``stop``.

        Raises `InputError` for a command that ends before.
        """
        for name, process, _ in self._children:
            while not self._ready[name].wait(0.1) and not stop.is_set():
                if process.poll() is not None:
                    raise InputError(
                        f"'marginguard {name}' ended with status {process.returncode} before it "
                        "was ready; expected it to run: its error is above"
                    )

    def close(self) -> None:
        """End all commands. Idempotent."""
        self._closing.set()
        for _, process, _ in self._children:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for _, process, reader in self._children:
            try:
                process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            reader.join()
        self._children = []

    def __enter__(self) -> "CommandGroup":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _read(self, name: str, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                self._ready[name].set()
                print(f"{name}: {line}", end="", flush=True)
        status = process.wait()
        if not self._closing.is_set():
            self._ended(name, status)


if __name__ == "__main__":
    end_with_parent(int(sys.argv.pop(1)))
    from app.cli.main import main

    sys.exit(main())
