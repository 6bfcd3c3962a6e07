"""Starts workers, ends inputs that do not return, and collects progress and findings."""

import json
import mmap
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.fuzz.outcome import CRASH, MAX_SECONDS, SLOW, Outcome
from benchmarks.fuzz.worker import CLOCK, Job, Progress, waited_ns

_POLL_S = 0.1
_CONFIRMATIONS = 2
"""A slow input is a finding if it is slow again in as many new workers."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Outcome of input ``number``."""

    number: int
    outcome: Outcome


@dataclass(slots=True)
class WorkerRun:
    """What a worker did: its progress, and its findings."""

    progress: Progress
    findings: list[Finding]


def run_inputs(
    parser: str,
    *,
    seed: int,
    first: int,
    last: int,
    seconds: float = 1e9,
    max_input_s: float = MAX_SECONDS,
) -> WorkerRun:
    """Run inputs of the parser at ``module:name`` in one worker, which may end early.

    It ends at ``last`` (exclusive), after ``seconds``, or after an input that fills the memory,
    takes longer than ``max_input_s`` or crashes.
    """
    return _run(parser, seed=seed, first=first, last=last, seconds=seconds, max_input_s=max_input_s)


def run_files(
    parser: str, files: Sequence[Path], *, inputs: int = 0, seed: int = 0
) -> list[WorkerRun]:
    """Run the parser on ``files`` and then on ``inputs`` generated ones, in one worker or more.

    The number of a finding in file ``i`` is ``i - len(files)``, which is negative.
    """
    names = tuple(map(str, files))
    runs: list[WorkerRun] = []
    following = -len(names)
    while following < inputs:
        left = names[following:] if following < 0 else ()
        run = _run(parser, files=left, seed=seed, first=max(following, 0), last=inputs)
        runs.append(run)
        following = run.progress.next
    return runs


def _run(parser: str, **options: object) -> WorkerRun:
    run = _run_once(parser, **options)
    for finding in [each for each in run.findings if each.outcome.kind == SLOW]:
        again = _run_again_if_not_slow(parser, finding.number, options)
        if again is not None:
            run.findings.remove(finding)
            run.findings += again.findings
            run.progress.values += again.progress.values
            run.progress.errors += again.progress.errors
    return run


def _run_again_if_not_slow(
    parser: str, number: int, options: dict[str, object]
) -> WorkerRun | None:
    """Run a slow input again; return the first run in which it is not slow."""
    again = {**options, "files": (), "first": number, "last": number + 1}
    if number < 0:
        again |= {"files": (options["files"][number],), "first": 0, "last": 0}  # type: ignore[index]
    for _ in range(_CONFIRMATIONS):
        run = _run_once(parser, **again)
        if all(each.outcome.kind != SLOW for each in run.findings):
            return run
    return None


def _run_once(parser: str, **options: object) -> WorkerRun:
    with _folders() as (folder, clock_file):
        job = Job(parser, str(folder), str(clock_file), **options)  # type: ignore[arg-type]
        with clock_file.open("r+b") as file, mmap.mmap(file.fileno(), CLOCK.size) as clock:
            return _supervised(job, clock)


def _supervised(job: Job, clock: mmap.mmap) -> WorkerRun:
    run = WorkerRun(Progress(job.start), [])
    with subprocess.Popen(
        [sys.executable, "-m", "benchmarks.fuzz.worker"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        assert process.stdin and process.stdout
        process.stdin.write(json.dumps(asdict(job)).encode())
        process.stdin.close()
        try:
            killed_at = _collect(process, clock, run, job.max_input_s)
        finally:
            _end(process)
    if killed_at is not None:
        detail = f"over {job.max_input_s:g} s, ended"
        run.findings.append(Finding(killed_at, Outcome(SLOW, detail, "time")))
        run.progress.next = killed_at + 1
    elif process.returncode not in (0, -signal.SIGKILL):
        number = max(int(CLOCK.unpack_from(clock)[0]), job.start)
        detail = f"the worker ended with status {process.returncode}"
        run.findings.append(Finding(number, Outcome(CRASH, detail, str(process.returncode))))
        run.progress.next = number + 1
    return run


def _collect(
    process: subprocess.Popen[bytes], clock: mmap.mmap, run: WorkerRun, max_s: float
) -> int | None:
    """Read reports to the end; return the number of an input that took too long."""
    assert process.stdout
    os.set_blocking(process.stdout.fileno(), False)
    rest = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while True:
            for _ in selector.select(_POLL_S):
                data = os.read(process.stdout.fileno(), 1 << 16)
                if not data:
                    process.wait()
                    return None
                *lines, rest = (rest + data).split(b"\n")
                for line in lines:
                    _take(json.loads(line), run)
            number, start_ns, wait_ns = CLOCK.unpack_from(clock)
            if start_ns == 0:
                continue
            wall_s = (time.monotonic_ns() - start_ns) / 1e9
            if wall_s <= max_s:
                continue
            waited_s = (waited_ns(process.pid) - wait_ns) / 1e9
            if wall_s - waited_s > max_s + _POLL_S:
                return int(number)


def _take(report: dict[str, object], run: WorkerRun) -> None:
    run.progress = Progress(**report["progress"])  # type: ignore[arg-type]
    if "outcome" in report:
        outcome = Outcome(**report["outcome"])  # type: ignore[arg-type]
        run.findings.append(Finding(int(str(report["number"])), outcome))


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the worker and what it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@contextmanager
def _folders() -> Iterator[tuple[Path, Path]]:
    """An empty folder for inputs, in memory where possible, and the file of the clock."""
    memory = Path("/dev/shm")
    parent = memory if os.access(memory, os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=parent) as name:
        folder, clock = Path(name) / "input", Path(name) / "clock"
        folder.mkdir()
        clock.write_bytes(bytes(CLOCK.size))
        yield folder, clock
