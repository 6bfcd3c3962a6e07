"""Runs inputs of parsers in a worker process, which is forked from a warm server.

The kernel ends an input that does not return: by its processor time, which does not depend on what
else runs on the machine, and by the clock where it waits for something.
"""

import os
import resource
import signal
import tempfile
from contextlib import suppress
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Self

from tests.fuzz.outcome import CRASH, MEMORY, PRINTED, SLOW, Outcome, observe

MAX_CPU_S, MAX_WAIT_S = 2.0, 120.0
"""Limits of one input: processor time, children included, and time by the clock."""

MAX_BYTES = 1 << 30
"""Limit of the resident memory that one input adds."""

_MAX_ADDRESSES = 16 << 30
"""Address space of the worker: an allocation beyond it fails instead of filling the machine."""

_CONFIRMATIONS = 2
"""A slow input is a finding if it is slow again in as many new workers."""

_CONTEXT = get_context("forkserver")


class Fuzzer:
    """Runs inputs of the parsers in ``PARSERS`` of the module ``table``, one after the other."""

    def __init__(
        self, table: str, *, max_cpu_s: float = MAX_CPU_S, max_wait_s: float = MAX_WAIT_S
    ) -> None:
        _CONTEXT.set_forkserver_preload([table])
        memory = Path("/dev/shm")
        parent = memory if os.access(memory, os.W_OK) else None
        self._folder = tempfile.TemporaryDirectory(prefix="fuzz-", dir=parent)
        self._options = (table, self._folder.name, max_cpu_s, max_wait_s)
        self._worker: tuple[BaseProcess, Connection] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        self._folder.cleanup()

    def run(self, name: str, data: bytes) -> Outcome:
        """Parse one input; after a finding the next one gets a new worker."""
        outcome = self._run_once(name, data)
        for _ in range(_CONFIRMATIONS):
            if outcome.kind == SLOW:
                outcome = self._run_once(name, data)
        return outcome

    def _run_once(self, name: str, data: bytes) -> Outcome:
        process, connection = self._worker = self._worker or self._start()
        connection.send((name, data))
        try:
            outcome: Outcome = connection.recv()
        except EOFError:
            process.join()
            is_slow = process.exitcode in (-signal.SIGPROF, -signal.SIGALRM)
            detail = f"the worker ended with status {process.exitcode}"
            outcome = Outcome(SLOW if is_slow else CRASH, detail)
        if outcome.is_finding:
            self._end()
        return outcome

    def _start(self) -> tuple[BaseProcess, Connection]:
        ours, theirs = _CONTEXT.Pipe()
        process = _CONTEXT.Process(target=_serve, args=(theirs, *self._options), daemon=True)
        process.start()
        theirs.close()
        return process, ours

    def _end(self) -> None:
        """End the worker and what it started."""
        if self._worker is not None:
            process, connection = self._worker
            with suppress(ProcessLookupError):
                os.killpg(process.pid or 0, signal.SIGKILL)
            process.join()
            connection.close()
            self._worker = None


def _serve(
    connection: Connection, table: str, folder: str, max_cpu_s: float, max_wait_s: float
) -> None:
    """Answer a name and the bytes of an input by the outcome; a signal ends the process."""
    os.setsid()
    parsers = import_module(table).PARSERS
    printed = os.memfd_create("printed")
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_ADDRESSES, _MAX_ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for number in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    with suppress(EOFError):
        while True:
            name, data = connection.recv()
            path = parsers[name].write(Path(folder) / name, data)
            # Largest resident memory from now on.
            Path("/proc/self/clear_refs").write_text("5")
            base, began_s = _resident_bytes("VmRSS"), _cpu_s()
            signal.setitimer(signal.ITIMER_PROF, max_cpu_s)
            signal.setitimer(signal.ITIMER_REAL, max_wait_s)
            outcome = observe(parsers[name], path)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            spent_s, text = _cpu_s() - began_s, os.pread(printed, 2000, 0)
            children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
            added = max(_resident_bytes("VmHWM"), children) - base
            if not outcome.is_finding:
                if added > MAX_BYTES:
                    outcome = Outcome(MEMORY, f"{added >> 20} MiB resident")
                elif spent_s > max_cpu_s:
                    outcome = Outcome(SLOW, f"{spent_s:.2f} s")
                elif text:
                    outcome = Outcome(PRINTED, text.decode("utf-8", "replace"))
            connection.send(outcome)


def _cpu_s() -> float:
    """Processor time of this process and of its children that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _resident_bytes(which: str) -> int:
    status = Path("/proc/self/status").read_text("ascii")
    line = next(line for line in status.splitlines() if line.startswith(which))
    return int(line.split()[1]) * 1024
