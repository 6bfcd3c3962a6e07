"""Slow work in a background thread, with callbacks in the scene's thread."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any, TypeVar

from app.geometry import MarginGuardError
from app.runtime import ITEM_COMMANDS, Operator, OperatorCommand, RequestKind

_NAMES: dict[str, str] = {
    RequestKind.TIP: "using the tip",
    **{each.kind: "using the tip" for each in ITEM_COMMANDS.values()},
    RequestKind.REGISTRATION: "using the registration",
    RequestKind.TUMOR: "setting the tumour",
}
_Value = TypeVar("_Value")


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    name: str
    future: "Future[Any]"
    then: Callable[[Any], None]


class Jobs:
    """Runs jobs one after the other in a thread; `collect` calls back in the caller's thread.

    ``done()`` is called in any thread when a job is done, to have `collect` called.
    """

    def __init__(self, done: Callable[[], None] = lambda: None) -> None:
        self._done = done
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="MarginGuard job")
        self._jobs: list[_Job] = []

    @property
    def current(self) -> str:
        """Name of the running job, empty if there is none."""
        return self._jobs[0].name if self._jobs else ""

    def submit(self, name: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Run ``work()`` in the background; a later `collect` calls ``then`` with its result."""
        future = self._executor.submit(work)
        self._jobs.append(_Job(name, future, then))
        future.add_done_callback(lambda _: self._done())

    def collect(self) -> str:
        """Call ``then`` of each finished job; return the last error as one line, or nothing."""
        failure = ""
        while self._jobs and self._jobs[0].future.done():
            job = self._jobs.pop(0)
            try:
                job.then(job.future.result())
            except Exception as error:
                failure = f"{job.name}: {one_line(error)}"
        return failure

    def wait(self, seconds: float) -> None:
        """Wait until the running job is done, at most ``seconds``."""
        if self._jobs:
            wait([self._jobs[0].future], seconds)

    def cancel(self) -> None:
        """Cancel waiting jobs and discard the result of the running one."""
        for job in self._jobs:
            job.future.cancel()
        self._jobs.clear()

    def close(self) -> None:
        """Cancel all jobs and wait until the running one has ended."""
        self.cancel()
        self._executor.shutdown()


class JobOperator:
    """`app.workflow.DisplayOperator` of the session that the panel shows: a request is a job.

    ``session()`` is the operator of that session; raises `InputError` without one.
    """

    def __init__(self, jobs: Jobs, session: Callable[[], Operator]) -> None:
        self._jobs = jobs
        self._session = session

    def request(self, command: OperatorCommand) -> bool:
        """Begin to carry ``command`` out; False while another job runs."""
        if self._jobs.current:
            return False
        operator = self._session()
        self._jobs.submit(_NAMES[command.kind], lambda: operator.request(command), lambda _: None)
        return True

    def compute(self, function: Callable[..., _Value], /, *args: Any) -> _Value:
        """Return ``function(*args)``, computed beside the session."""
        return self._session().compute(function, *args)


def one_line(error: BaseException) -> str:
    """Format ``error`` for the panel; log the traceback of an unexpected one."""
    text = " ".join(str(error).split())
    if isinstance(error, MarginGuardError | OSError) and text:
        return text
    logging.error("MarginGuard: unexpected error", exc_info=error)
    return f"unexpected {type(error).__name__}: {text} (see the log)"
