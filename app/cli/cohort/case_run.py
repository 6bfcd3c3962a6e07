"""Work of a worker: make or fetch one case, replay it, return its row."""

import ctypes
import gc
import os
import resource
import socket
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from app import __version__
from app.cli.gc_control import GcPause
from app.cohort import CohortCase, failed, fetch, finished, identity_of, is_url
from app.cohort.columns import FAILED, LOST, Row
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
    from app.synthetic import BASE_FRAME, CAUTERY_TIP_FRAME
    from app.synthetic.motion import TouchArm

    return TouchArm(base_frame=BASE_FRAME, tip_frame=CAUTERY_TIP_FRAME)


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
