"""What takes long, done beside the scene's thread; its results come back to that thread."""

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
    """One job after the other in a thread; `collect` hands out what is done, where it is called."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="MarginGuard job")
        self._jobs: list[_Job] = []

    @property
    def at_work(self) -> str:
        """What is being done, for the panel; empty when nothing is."""
        return self._jobs[0].name if self._jobs else ""

    def begin(self, name: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Do ``work()`` beside this thread; a later `collect` calls ``then(its result)``."""
        self._jobs.append(_Job(name, self._executor.submit(work), then))

    def collect(self) -> str:
        """Call ``then`` of the jobs that are done; the line of the last that failed, or nothing."""
        said = ""
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.pop(0)
            try:
                job.then(job.future.result())
            except Exception as error:
                said = f"{job.name}: {one_line(error)}"
        return said

    def wait(self, seconds: float) -> None:
        """Let the job that is at work go on for so long, or until it is done."""
        if self._jobs:
            wait([self._jobs[0].future], seconds)

    def forget(self) -> None:
        """Do nothing with the results of the jobs that were begun, and no job that waits."""
        for job in self._jobs:
            job.future.cancel()
        self._jobs.clear()

    def close(self) -> None:
        """Forget all of them, and wait for the one that is at work."""
        self.forget()
        self._executor.shutdown()


def one_line(error: BaseException) -> str:
    """The error for the panel; one that nobody foresaw goes to Slicer's log as a whole as well."""
    text = " ".join(str(error).split())
    if isinstance(error, MarginGuardError | OSError) and text:
        return text
    logging.error("MarginGuard: unexpected error", exc_info=error)
    return f"unexpected {type(error).__name__}: {text} (the log has all of it)"
