"""Runs jobs on Dask distributed, with a bounded number of them at a time.

Workers that die are replaced by Dask, which repeats their jobs. A scheduler that goes away takes
its jobs along: they are submitted again when it has returned.
"""

import logging
import queue
import time
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from typing import Any, Self

import dask
from distributed import Client, Future, KilledWorker, LocalCluster

from app.cli.cohort_run import Job, Outcome, run_job
from app.cohort import failed, identity_of
from app.cohort.columns import LOST
from app.geometry import InputError

JOBS_PER_THREAD = 3
"""Jobs that are submitted at a time, for each thread of the workers: memory stays flat."""

_SETTINGS = {
    "distributed.comm.timeouts.connect": "10s",
    # A worker samples its own stacks every 10 ms and keeps them for an hour: 1 MB for each case.
    "distributed.worker.profile.enabled": False,
}
_POLL_S = 1.0
_CONNECT_S = 10.0
_RETURN_S = 600.0
"""Time that a scheduler that went away has to return."""


class DaskPool:
    """Workers of an embedded cluster, or those of the scheduler at ``address``."""

    def __init__(self, address: str | None, workers: int) -> None:
        self._address, self._workers = address, workers
        self._stack = ExitStack()
        self._client: Client
        self._submitted = 0

    def __enter__(self) -> Self:
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        logging.getLogger("tornado").setLevel(logging.CRITICAL)
        self._stack.enter_context(dask.config.set(_SETTINGS))
        try:
            if self._address is None:
                # Loopback only, with certificates of this run: jobs are code, and a scheduler
                # without them executes that of every user of the machine.
                cluster = LocalCluster(
                    n_workers=self._workers,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    security=True,
                    silence_logs=logging.CRITICAL,
                )
                self._stack.enter_context(cluster)
                self._client = self._stack.enter_context(Client(cluster))
            else:
                self._client = Client(self._address, timeout=_CONNECT_S)
        except (OSError, ValueError) as error:
            self._stack.close()
            where = "the embedded cluster" if self._address is None else self._address
            raise InputError(f"{where}: no scheduler ({error}); expected a running one") from error
        return self

    def __exit__(self, *_: object) -> None:
        if self._address is not None:
            self._client.close(timeout=2)
        self._stack.close()

    @property
    def dashboard(self) -> str:
        """Address of Dask's dashboard."""
        return str(self._client.dashboard_link)

    def run(self, jobs: Iterable[Job]) -> Iterator[tuple[Job, Outcome]]:
        """Yield each job with its outcome, in the order in which they finish."""
        source, again = iter(jobs), deque[Job]()
        pending: dict[Future[Any], Job] = {}
        done: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        exhausted = False
        while True:
            while len(pending) < self._limit() and not (exhausted and not again):
                job = again.popleft() if again else next(source, None)
                if job is None:
                    exhausted = True
                    break
                self._submitted += 1
                key = f"case-{job.case.name}-{self._submitted}"
                future = self._client.submit(run_job, job, key=key, pure=False)
                pending[future] = job
                future.add_done_callback(done.put)
            if not pending:
                return
            try:
                future = done.get(timeout=_POLL_S)
            except queue.Empty:
                if self._lost():
                    again.extend(pending.values())
                    pending.clear()
                    self._reconnect()
                continue
            job = pending.pop(future, None)
            if job is None:
                continue  # of an earlier connection
            outcome = self._outcome(future, job)
            if outcome is None:
                again.append(job)
                self._reconnect()
            else:
                yield job, outcome

    def _outcome(self, future: "Future[Any]", job: Job) -> Outcome | None:
        """The outcome; None if the job was lost with the scheduler."""
        if future.status in ("cancelled", "lost"):
            return None
        try:
            outcome: Outcome = future.result(timeout=_CONNECT_S)
        except KilledWorker as error:
            died = error.allowed_failures + 1
            reason = f"{died} worker{'s' * (died > 1)} died while running this case"
            return self._lost_case(job, reason)
        except (OSError, TimeoutError):
            return None
        except Exception as error:
            if future.status in ("cancelled", "lost") or self._lost():
                return None
            return self._lost_case(job, f"the worker cannot run it: {error}")
        return outcome

    def _lost_case(self, job: Job, reason: str) -> Outcome:
        row = identity_of(job.case, job.input_hash, job.version)
        return Outcome(failed(row, LOST, reason), 0.0, 0.0, 0.0)

    def _limit(self) -> int:
        try:
            info: dict[str, Any] = self._client.scheduler_info(n_workers=-1)
            threads = sum(worker["nthreads"] for worker in info["workers"].values())
        except (OSError, ValueError, KeyError, TypeError):
            threads = 0
        return JOBS_PER_THREAD * max(int(threads), 2)

    def _lost(self) -> bool:
        return self._client.status != "running"

    def _reconnect(self) -> None:
        """Wait until the scheduler is there; raises `InputError` if it does not return in time."""
        deadline = time.monotonic() + _RETURN_S
        while self._lost():
            if time.monotonic() > deadline or self._address is None:
                raise InputError(
                    f"the scheduler {self._address or 'of the embedded cluster'} went away and did "
                    "not return; finished cases are kept, the same command continues"
                )
            if self._client.status in ("closed", "closing"):
                try:
                    self._client = Client(self._address, timeout=_CONNECT_S)
                except (OSError, ValueError):
                    time.sleep(_POLL_S)
            else:  # Dask reconnects by itself
                time.sleep(0.1)
