"""A run of a cohort: which cases are left, complete partitions, costs, and the work of a worker."""

import csv
import ctypes
import fcntl
import gc
import io
import os
import resource
import socket
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

from app import __version__
from app.cli.process import GcPause
from app.cli.progress import Report
from app.cohort import (
    Cohort,
    CohortCase,
    Dataset,
    failed,
    fetch,
    finished,
    identity_of,
    input_hash,
    is_url,
)
from app.cohort.columns import FAILED, LOST, Row
from app.cohort.dataset import PARTITION_CASES
from app.files.atomic_io import write_file, writing
from app.geometry import InputError, MarginGuardError

if TYPE_CHECKING:
    from app.runtime import PreparedCase
    from app.session import ToolEngines
    from app.synthetic.motion import TouchArm


@dataclass(frozen=True, slots=True)
class Job:
    """A case, the hash of its input, and the version that the client expects of the workers."""

    case: CohortCase
    input_hash: str
    version: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """The row of a case, and what it cost: wall and processor time, resident memory after it.

    ``worker``: host and process that ran it; empty if none did.
    """

    row: Row
    wall_s: float
    cpu_s: float
    rss_mb: float
    worker: str = ""


def run_job(job: Job) -> Outcome:
    """Run a case. An error becomes the reason of its row and is never raised."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with GcPause() as memory:
        memory.settle()  # libraries and what Dask holds stay: only objects of the case are scanned
        row = _row(job)
        _release_memory()
    worker = f"{socket.gethostname()}:{os.getpid()}"
    wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    return Outcome(row, wall_s, cpu_s, _resident_mb(), worker)


def _row(job: Job) -> Row:
    row = identity_of(job.case, job.input_hash, job.version)
    scratch = _scratch()
    try:
        if job.version != __version__:
            raise OSError(f"the worker has MarginGuard {__version__}; expected {job.version}")
        with tempfile.TemporaryDirectory(prefix="marginguard-case-", dir=scratch) as temporary:
            folder = Path(temporary) / "case"
            try:
                row = finished(row, *_results(_prepared(job.case, folder)))
            except MarginGuardError as error:
                # The same text on every worker.
                row = failed(row, FAILED, str(error).replace(f"{folder}", job.case.name))
    except OSError as error:
        reason = error.strerror or str(error)
        row = failed(row, LOST, f"{type(error).__name__}: {reason}")
    except Exception as error:  # a fault in the program must not stop the other cases
        row = failed(row, FAILED, f"unexpected {type(error).__name__}: {error}")
    return row


def _prepared(case: CohortCase, folder: Path) -> "PreparedCase":
    """The case, ready to be replayed; ``folder`` is for what it does not find elsewhere."""
    from app.runtime import prepare_case
    from app.synthetic import simulate_unrecorded_case

    frames = None
    if case.synthetic is not None:
        made = case.synthetic
        frames = simulate_unrecorded_case(
            folder, seed=made.seed, arm=_arm(), options=made.options()
        )
    elif is_url(case.source):
        folder.mkdir()
        fetch(case.source, folder)
    else:
        folder = Path(case.source)
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder; expected a case folder")
    return prepare_case(folder, frames=frames, tip_only=case.tip_only, make_engine=_engines())


def _results(prepared: "PreparedCase") -> tuple[dict[str, object], dict[str, object]]:
    """The summary of a replay of the case, and the flat record of its analysis."""
    from app.analysis import analyse_case
    from app.report import ReplayLog, record_of, summarise
    from app.runtime import ReplayRun

    log = ReplayLog()
    replay = ReplayRun(prepared, clock_ns=time.monotonic_ns, outputs=(log,))
    for _ in replay.steps():
        pass
    content = prepared.content
    analysis = analyse_case(
        log.samples(), name=content.name, margins=content.margins, tumor=content.tumor
    )
    return summarise(record_of(replay, log)), dict(analysis.flat())


@cache
def _arm() -> "TouchArm":
    from app.synthetic.motion import TouchArm

    return TouchArm()


@cache
def _engines() -> "ToolEngines":
    from app.session import ToolEngines

    return ToolEngines()


def _scratch() -> str | None:
    """The folder of the Dask worker, which is removed also after the worker was killed."""
    from distributed import get_worker

    try:
        return str(get_worker().local_directory)
    except ValueError:  # not on a worker
        return None


def _release_memory() -> None:
    """Return what the case has used to the system.

    The allocator of glibc keeps freed blocks between those in use: a worker would grow by 70 MB
    over its first eight cases.
    """
    gc.collect()
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError):  # another C library
        return
    trim(0)


def _resident_mb() -> float:
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:  # not Linux: the peak
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return pages * resource.getpagesize() / 1e6


TIMES_FILE = "times.csv"
LOCK_FILE = ".lock"

_EDITABLE = ("source", "group", "surgeon", "pair")
"""Keys that a manifest may change of a finished case."""

RunJobs = Callable[[Iterable[Job]], Iterator[tuple[Job, Outcome]]]


@dataclass(slots=True)
class Counts:
    """Cases of a run: in all, kept of earlier runs, done now, and with an error."""

    total: int
    kept: int = 0
    done: int = 0
    failed: int = 0


@dataclass(slots=True)
class _Partition:
    cases: list[CohortCase]
    rows: dict[str, Row] = field(default_factory=dict)


class CohortRun:
    """Runs ``cohort`` into ``dataset``; ``version`` is that of the program."""

    def __init__(
        self,
        cohort: Cohort,
        dataset: Dataset,
        version: str,
        *,
        partition_cases: int = PARTITION_CASES,
    ) -> None:
        self._cohort, self._dataset, self._version = cohort, dataset, version
        self._size = partition_cases
        self.counts = Counts(len(cohort))
        self._open: dict[int, _Partition] = {}
        self._place: dict[str, int] = {}
        self._times: list[tuple[str, Outcome]] = []

    def run(self, run_jobs: RunJobs, report: Report = lambda done, total: None) -> Counts:
        """Do what is left; every partition is written when its last case is done."""
        with _locked(self._dataset.folder):
            jobs = self._jobs()
            first = next(jobs, None)
            if first is not None:
                for job, outcome in run_jobs(chain([first], jobs)):
                    self._add(job.case.name, outcome)
                    report(self.counts.kept + self.counts.done, self.counts.total)
            self._dataset.close(-(-self.counts.total // self._size))
            if self._times:
                write_file(self._dataset.folder / TIMES_FILE, self._times_csv())
        return self.counts

    def _jobs(self) -> Iterator[Job]:
        """Jobs of the cases that are not finished; partitions without one are written here."""
        finished = self._dataset.open()
        cases = iter(self._cohort)
        number = 0
        with ThreadPoolExecutor(4) as pool:
            while batch := list(islice(cases, self._size)):
                partition = self._open[number] = _Partition(batch)
                left = []
                for case, (digest, problem) in zip(batch, pool.map(_hash, batch), strict=True):
                    row = None if problem else finished.get(case.name, digest, self._version)
                    if row is not None:
                        row |= {key: getattr(case, key) for key in _EDITABLE}
                        self.counts.kept += 1
                    elif problem:
                        row = failed(identity_of(case, "", self._version), FAILED, problem)
                        self.counts.done += 1
                    if row is None:
                        left.append(Job(case, digest, self._version))
                        self._place[case.name] = number
                    else:
                        self._count(row)
                        partition.rows[case.name] = row
                self._write(number)
                yield from left
                number += 1

    def _add(self, name: str, outcome: Outcome) -> None:
        number = self._place.pop(name)
        self.counts.done += 1
        self._count(outcome.row)
        self._times.append((name, outcome))
        self._open[number].rows[name] = outcome.row
        self._dataset.append(outcome.row)
        self._write(number)

    def _count(self, row: Row) -> None:
        self.counts.failed += row["status"] != "ok"

    def _write(self, number: int) -> None:
        partition = self._open[number]
        if len(partition.rows) < len(partition.cases):
            return
        del self._open[number]
        rows = [partition.rows[case.name] for case in partition.cases]
        pending = (row for other in self._open.values() for row in other.rows.values())
        self._dataset.write_partition(number, rows, pending)

    def _times_csv(self) -> bytes:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("name", "wall_s", "cpu_s", "rss_mb", "worker"))
        for name, outcome in self._times:
            costs = (outcome.wall_s, outcome.cpu_s, outcome.rss_mb)
            writer.writerow((name, *(f"{cost:.3f}" for cost in costs), outcome.worker))
        return text.getvalue().encode()


def _hash(case: CohortCase) -> tuple[str, str]:
    """The hash of the input and no problem, or no hash and the problem."""
    try:
        return input_hash(case), ""
    except (InputError, OSError) as error:
        return "", str(error)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Exclusive access to the folder of results; raises `InputError` if another run has it."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / LOCK_FILE).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise InputError(
                    f"{folder} is in use by another run; expected another folder, or its end"
                ) from error
            yield
