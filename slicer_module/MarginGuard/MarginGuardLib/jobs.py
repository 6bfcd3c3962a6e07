"""Long work in a worker thread; its results are handled in the scene's thread."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

from app.geometry import MarginGuardError


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    name: str
    future: "Future[Any]"
    then: Callable[[Any], None]


class Jobs:
    """Runs jobs one by one in a thread; `collect` handles results in the calling thread."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="MarginGuard job")
        self._jobs: list[_Job] = []

    @property
    def running(self) -> str:
        """Name of the present job for the panel; empty if there is none."""
        return self._jobs[0].name if self._jobs else ""

    def begin(self, name: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Run ``work()`` in the worker thread; a later `collect` calls ``then(result)``."""
        self._jobs.append(_Job(name, self._executor.submit(work), then))

    def collect(self) -> str:
        """Call ``then`` of finished jobs; return the error of the last failed one, or empty."""
        failure = ""
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.pop(0)
            try:
                job.then(job.future.result())
            except Exception as error:
                failure = f"{job.name}: {one_line(error)}"
        return failure

    def wait(self, seconds: float) -> None:
        """Wait until the present job is done, at most ``seconds``."""
        if self._jobs:
            wait([self._jobs[0].future], seconds)

    def forget(self) -> None:
        """Drop the results of started jobs, and cancel jobs that wait."""
        for job in self._jobs:
            job.future.cancel()
        self._jobs.clear()

    def close(self) -> None:
        """Drop all jobs, and wait for the present one to end."""
        self.forget()
        self._executor.shutdown()


def one_line(error: BaseException) -> str:
    """The error in one line for the panel; an unexpected one is logged with its traceback too."""
    text = " ".join(str(error).split())
    if isinstance(error, MarginGuardError | OSError) and text:
        return text
    logging.error("MarginGuard: unexpected error", exc_info=error)
    return f"unexpected {type(error).__name__}: {text} (the log has all of it)"
