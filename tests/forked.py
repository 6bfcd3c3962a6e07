"""Processes that are forked from one warm parent: a process of its own without a second of imports.

The parent has imported the libraries of a replay, and has no thread. A child gets its own folder,
variables and standard streams, executes Python code, and ends as an interpreter ends, so that what
measures coverage writes its data. Use a real process where the start of an interpreter is tested.
"""

import atexit
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import IO, Any

ROOT = Path(__file__).resolve().parents[1]
COMMAND = "import sys; from app.cli.main import main; sys.exit(main())"
"""Code that runs ``marginguard`` with the arguments of the process."""

MAX_REQUEST_BYTES = 1 << 20


class Forked:
    """A forked process, used as a `subprocess.Popen` with three pipes."""

    def __init__(
        self,
        code: str,
        *arguments: object,
        folder: Path = ROOT,
        environment: Mapping[str, str] | None = None,
        stdout: int | None = None,
    ) -> None:
        theirs, ours = zip(os.pipe(), *(os.pipe()[::-1] for _ in range(2)), strict=True)
        streams = [theirs[0], theirs[1] if stdout is None else stdout, theirs[2]]
        request = {
            "code": code,
            "arguments": [str(argument) for argument in arguments],
            "folder": str(folder),
            "environment": dict(os.environ | (environment or {})),
        }
        self.pid = _asked(request, streams)
        self.returncode: int | None = None
        self._ended = os.pidfd_open(self.pid)
        for descriptor in theirs:
            os.close(descriptor)
        self.stdin: IO[str] = os.fdopen(ours[0], "w")
        self.stdout: IO[str] = os.fdopen(ours[1])
        self.stderr: IO[str] = os.fdopen(ours[2])

    def send_signal(self, number: int) -> None:
        """Send a signal to the process; its id is not used again before its end was awaited."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def poll(self) -> int | None:
        """The exit status, negative after a signal; None while the process runs."""
        if self.returncode is None and select.select([self._ended], [], [], 0)[0]:
            self.wait()
        return self.returncode

    def wait(self, timeout: float = 120.0) -> int:
        """Wait for the end of the process; return its exit status."""
        if self.returncode is None:
            if not select.select([self._ended], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired("forked process", timeout)
            self.returncode = _asked({"wait": self.pid}, [])
        return self.returncode

    def communicate(self, timeout: float = 120.0) -> tuple[str, str]:
        """Close standard input; wait for the end; what was printed, which must fit in a pipe."""
        self.stdin.close()
        self.wait(timeout)
        return self.stdout.read(), self.stderr.read()

    def __enter__(self) -> "Forked":
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()
        self.wait()
        for stream in (self.stdin, self.stdout, self.stderr):
            stream.close()
        os.close(self._ended)


def run_forked(
    code: str, *arguments: object, timeout: float = 120.0, **options: Any
) -> "subprocess.CompletedProcess[str]":
    """Run ``code`` in a forked process to its end."""
    with Forked(code, *arguments, **options) as process:
        out, err = process.communicate(timeout)
        return subprocess.CompletedProcess(arguments, process.wait(), out, err)


@cache
def _parent() -> socket.socket:
    """Connection to the parent of all forked processes, which ends with this process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.forked", str(theirs.fileno())],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *_python_path()])},
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C on the terminal goes to the tests only
        )

    @atexit.register
    def end() -> None:
        ours.close()
        process.wait()

    return ours


def _python_path() -> list[str]:
    return [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]


def _asked(request: dict[str, Any], streams: list[int]) -> int:
    socket.send_fds(_parent(), [json.dumps(request).encode()], streams)
    reply = _parent().recv(64)
    assert reply, "the parent of the forked processes has ended"
    return int(reply)


def _load() -> None:
    """Import what most commands need. Nothing is computed: threads of OpenMP do not survive a fork,
    and rclpy crashes in a process that was forked after its import."""
    import fcl  # noqa: F401
    import mcap.reader  # noqa: F401
    import numba  # noqa: F401
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401
    import yaml  # noqa: F401

    import app.cli.main  # noqa: F401


def _serve(link: socket.socket) -> None:
    """Fork a process for each request, in which this function runs its code."""
    while True:
        data, streams, *_ = socket.recv_fds(link, MAX_REQUEST_BYTES, 3)
        if not data:
            return
        request = json.loads(data)
        if "wait" in request:
            reply = os.waitstatus_to_exitcode(os.waitpid(request["wait"], 0)[1])
        elif (reply := os.fork()) == 0:
            link.close()
            _become(request, streams)
            return
        for stream in streams:
            os.close(stream)
        link.send(str(reply).encode())


def _become(request: dict[str, Any], streams: list[int]) -> None:
    for target, stream in enumerate(streams):
        os.dup2(stream, target)
        os.close(stream)
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    sys.argv = ["forked", *request["arguments"]]
    exec(compile(request["code"], "<forked>", "exec"), {"__name__": "__main__"})


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        _load()
        gc.freeze()  # else a child scans all of it at its end, which takes half a second
        _serve(connection)
