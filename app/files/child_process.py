"""Child processes: how they are started, asked, limited and put behind, and reports of their end.

`ask` sends one request to a module that calls `answer_request`, and returns its answer.
"""

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, NoReturn

from app.files.paths import checkout

_NICENESS = 5
"""Low enough for the thread of the constraint to go first, high enough to proceed beside others."""

Ask = Callable[[bytes], tuple[int, bytes]]
"""Sends a request to a new process; returns its exit status and its answer."""


class ChildError(OSError):
    """A process that cannot be started or takes too long; the message follows its name.

    Every caller raises an error of its own for it.
    """


def module_command(module: str, *arguments: str) -> list[str]:
    """The command that runs ``module``; a file of the current folder replaces no import."""
    return [sys.executable, "-P", "-m", module, *arguments]


def same_code(**added: str) -> dict[str, str]:
    """The variables of this process, by which Python imports the same code, and ``added``."""
    paths = [str(checkout() or ""), *sys.path]
    return {**os.environ, **added, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


def run_to_end(
    command: Sequence[str],
    max_s: float,
    request: bytes = b"",
    environment: Mapping[str, str] | None = None,
) -> "subprocess.CompletedProcess[bytes]":
    """Run ``command`` with ``request`` as its standard input, and return what it prints.

    Raises `ChildError` if it cannot be started, or has to be killed after ``max_s``.
    """
    try:
        return subprocess.run(
            command, input=request, capture_output=True, env=environment, timeout=max_s, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ChildError(f"did not answer within {max_s:g} s") from error
    except OSError as error:
        raise ChildError(f"cannot be started: {error.strerror}") from error


def ask(module: str, request: bytes, *, max_s: float, **variables: str) -> tuple[int, bytes]:
    """Send ``request`` to ``module`` in a new process; raises as `run_to_end`."""
    done = run_to_end(module_command(module), max_s, request, same_code(**variables))
    return done.returncode, done.stdout


def answer_request(answer: Callable[[IO[bytes]], Iterable[bytes]]) -> NoReturn:
    """Write the parts of ``answer(standard input)`` to standard output, and end this process.

    What libraries print goes to standard error, so that it does not corrupt the answer. The
    teardown of native libraries is skipped: it has crashed after everything was written.
    """
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as output:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        for part in answer(sys.stdin.buffer):
            output.write(part)
            output.flush()
    sys.stderr.flush()
    os._exit(0)


def limit_this_process(max_cpu_s: float, max_memory_bytes: int) -> None:
    """Limit the processor time (then SIGPROF ends it) and the memory from now on; no file writes.

    Writes to pipes are not limited.
    """
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    addresses = pages * resource.getpagesize() + max_memory_bytes
    resource.setrlimit(resource.RLIMIT_AS, (addresses, addresses))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, max_cpu_s)


def reported_error(line: bytes) -> str:
    """The message of the error that a command prints with ``--json``; empty for other lines."""
    with suppress(ValueError, KeyError, TypeError):
        return " ".join(str(json.loads(line)["error"]["message"]).split())
    return ""


def started_behind(module: str) -> "subprocess.Popen[bytes]":
    """``module`` in a new process with pipes, which gives way to this one.

    Ctrl-C on the terminal does not reach it.
    """
    process = subprocess.Popen(
        module_command(module),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=same_code(),
        start_new_session=True,
    )
    work_behind(process)
    return process


def step_back() -> None:
    """Let this process give way to others that start with its present priority."""
    os.nice(_NICENESS)


def work_behind(process: "subprocess.Popen[bytes]") -> None:
    """Let the new ``process`` give way to this one."""
    with suppress(ProcessLookupError):  # it has ended: its user reports that
        os.setpriority(os.PRIO_PROCESS, process.pid, os.nice(0) + _NICENESS)
