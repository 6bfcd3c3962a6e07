"""Worker process: runs inputs of one parser and reports on its standard output.

Reads a `Job` as JSON from the standard input. What the parser prints goes to a file in memory and
is a finding. The start of the current input is in a file that the parent maps, so that the parent
can end an input that does not return.
"""

import json
import mmap
import os
import resource
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.fuzz import forked
from benchmarks.fuzz.forked import scheduler_wait_ns
from benchmarks.fuzz.outcome import (
    MAX_BYTES,
    MAX_SECONDS,
    MEMORY,
    PRINTED,
    SLOW,
    Outcome,
    observe,
)
from benchmarks.fuzz.parser import FuzzedParser, make_input
from benchmarks.fuzz.registry import parser_at

CLOCK = struct.Struct("qqq")
"""Number of the current input; its start; time that the process had waited for a processor then."""

_MAX_ADDRESSES = 8 << 30
"""Address space of the worker: an allocation beyond it fails instead of filling the machine."""

_REPORT_NS = 500_000_000


@dataclass(slots=True)
class Job:
    """Inputs of the parser at ``module:name``: ``files``, then ``first`` to ``last`` (exclusive).

    The files have the numbers from ``-len(files)`` to -1.

    ``folder`` is an empty folder for the input, ``clock`` the file of the start. The worker ends
    after ``seconds``. An input of more than ``max_input_s`` is a finding.
    """

    parser: str
    folder: str
    clock: str
    seed: int = 0
    first: int = 0
    last: int = 0
    seconds: float = 1e9
    max_input_s: float = MAX_SECONDS
    files: tuple[str, ...] = ()

    @property
    def start(self) -> int:
        """Number of the first input."""
        return self.first - len(self.files)


@dataclass(slots=True)
class Progress:
    """Counts of a worker since its start; ``next`` is the first input that was not run."""

    next: int
    values: int = 0
    errors: int = 0
    slowest_s: float = 0.0
    peak_bytes: int = 0


def waited_ns(process: int | str = "self") -> int:
    """Time that the process, and its children that still run, have waited for a processor."""
    children = Path(f"/proc/{process}/task/{process}/children")
    try:
        running = children.read_text().split()
    except OSError:
        running = []
    return sum(map(scheduler_wait_ns, (process, *running)))


def main() -> None:
    """Run the job that the standard input describes."""
    job = Job(**json.load(sys.stdin))
    reports = os.fdopen(os.dup(1), "w", buffering=1)
    printed = os.memfd_create("printed")
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_ADDRESSES, _MAX_ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    parser = parser_at(job.parser)
    folder = Path(job.folder)
    for name, content in parser.companions.items():
        (folder / name).write_bytes(content)
    path = folder / parser.file_name
    progress, sent_ns = Progress(job.start), time.monotonic_ns()
    end_ns = sent_ns + int(job.seconds * 1e9)
    with Path(job.clock).open("r+b") as file, mmap.mmap(file.fileno(), CLOCK.size) as clock:
        CLOCK.pack_into(clock, 0, progress.next, 0, 0)
        for number, data in _inputs(parser, job):
            path.write_bytes(data)
            _reset_own_peak()
            wait_ns, start_ns = _all_waited_ns(), time.monotonic_ns()
            CLOCK.pack_into(clock, 0, number, start_ns, scheduler_wait_ns("self"))
            outcome = observe(parser.parse, path, names_file=parser.names_file)
            now_ns = time.monotonic_ns()
            seconds = (now_ns - start_ns - (_all_waited_ns() - wait_ns)) / 1e9
            CLOCK.pack_into(clock, 0, number + 1, 0, 0)
            outcome = _measured(outcome, seconds, printed, progress, job)
            progress.next = number + 1
            if outcome.kind == "value":
                progress.values += 1
            elif outcome.kind == "error":
                progress.errors += 1
            else:
                _send(reports, number=number, outcome=asdict(outcome), progress=asdict(progress))
            if now_ns - sent_ns > _REPORT_NS:
                _send(reports, progress=asdict(progress))
                sent_ns = now_ns
            # What a parser has filled may stay in use, so a new process takes over.
            if outcome.kind == MEMORY or now_ns > end_ns:
                break
    _send(reports, progress=asdict(progress), done=True)


def _all_waited_ns() -> int:
    """Time that this process and its children that have ended waited for a processor."""
    return scheduler_wait_ns("self") + forked.waited_ns


def _inputs(parser: FuzzedParser, job: Job) -> Iterator[tuple[int, bytes]]:
    for index, file in enumerate(job.files):
        yield index - len(job.files), Path(file).read_bytes()
    seeds = parser.seeds()
    for number in range(job.first, job.last):
        yield number, make_input(parser, seeds, job.seed, number)


def _reset_own_peak() -> None:
    """Begin to measure `_own_peak` anew: a mutation may need more memory than the parser."""
    Path("/proc/self/clear_refs").write_text("5")


def _own_peak() -> int:
    """Largest resident memory of this program in bytes, without that of the one that started it.

    ``ru_maxrss`` contains the latter: a process has its parent's memory until it runs a program.
    """
    status = Path("/proc/self/status").read_text("ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmHWM:"))
    return int(line.split()[1]) * 1024


def _measured(
    outcome: Outcome, seconds: float, printed: int, progress: Progress, job: Job
) -> Outcome:
    """The outcome, or a finding about its time, its memory or what it printed."""
    peak = max(_own_peak(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
    progress.slowest_s = max(progress.slowest_s, seconds)
    progress.peak_bytes = max(progress.peak_bytes, peak)
    size = os.fstat(printed).st_size
    if size:
        text = os.pread(printed, 2000, 0).decode("utf-8", "replace")
        os.ftruncate(printed, 0)
        os.lseek(printed, 0, os.SEEK_SET)
    if outcome.kind not in ("value", "error"):
        return outcome
    if peak > MAX_BYTES:
        return Outcome(MEMORY, f"{peak >> 20} MiB resident", "memory")
    if seconds > job.max_input_s:
        return Outcome(SLOW, f"{seconds:.2f} s", "time")
    if size:
        return Outcome(PRINTED, text, "".join(c for c in text[:80] if not c.isdigit()))
    return outcome


def _send(reports: object, **message: object) -> None:
    print(json.dumps(message), file=reports, flush=True)  # type: ignore[call-overload]


if __name__ == "__main__":
    main()
