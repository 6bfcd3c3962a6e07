"""A run of a cohort: which cases are left, partitions that are complete, costs of the cases."""

import csv
import fcntl
import io
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

from app.cli.cohort.case_run import Job, Outcome
from app.cli.progress import Report
from app.cohort import Cohort, CohortCase, Dataset, failed, identity_of, input_hash
from app.cohort.columns import FAILED, Row
from app.cohort.dataset import PARTITION_CASES
from app.files.atomic_io import write_file
from app.geometry import InputError

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

    @property
    def complete(self) -> bool:
        return len(self.rows) == len(self.cases)


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
                for job, outcome in run_jobs(_chain(first, jobs)):
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
        if not partition.complete:
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


def _chain(first: Job, others: Iterator[Job]) -> Iterator[Job]:
    yield first
    yield from others


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Exclusive access to the folder of results; raises `InputError` if another run has it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / LOCK_FILE).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise InputError(
                    f"{folder} is in use by another run; expected another folder, or its end"
                ) from error
            yield
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror}") from error
