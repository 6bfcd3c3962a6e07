"""Computes the fits of a guided calibration or registration beside the thread that shows them."""

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, Protocol, TypeVar

from app.runtime.compute import Compute

MAX_FAILURES = 3
"""Fits of one recording that may fail by an error of the program; then no further one is begun."""


class RunTask(Protocol):
    """A task of the recording with number ``run``."""

    @property
    def run(self) -> int:
        """Number of the recording."""


_Task = TypeVar("_Task", bound=RunTask)
_Fit = TypeVar("_Fit")
_TaskOut = TypeVar("_TaskOut", covariant=True)
_FitIn = TypeVar("_FitIn", contravariant=True)


class Guide(Protocol[_TaskOut, _FitIn]):
    """Source of the tasks to be fitted, and receiver of the results."""

    def task(self) -> _TaskOut | None:
        """The next task, None while there is none."""

    def use_fit(self, fit: _FitIn, /) -> None:
        """Take a result."""


class GuidedFits(Generic[_Task, _Fit]):
    """One fit at a time. The thread that shows the results owns it.

    ``compute`` calls ``fit`` in a thread of this object, ``on_computed`` is called from it.
    """

    def __init__(
        self,
        guide: Guide[_Task, _Fit],
        fit: Callable[[_Task], _Fit],
        compute: Compute,
        on_computed: Callable[[], None],
    ) -> None:
        self._guide = guide
        self._fit = fit
        self._compute = compute
        self._on_computed = on_computed
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="guided fit")
        self._computing: tuple[int, Future[_Fit]] | None = None
        self._failed_run, self._failures = 0, 0

    @property
    def is_done(self) -> bool:
        """True if a result waits for `follow`."""
        return self._computing is not None and self._computing[1].done()

    def follow(self) -> None:
        """Take a result that is done, and begin the next task."""
        if self._computing is not None and self._computing[1].done():
            (run, done), self._computing = self._computing, None
            self._take(run, done)
        task = None if self._computing is not None else self._guide.task()
        if task is None or (task.run == self._failed_run and self._failures >= MAX_FAILURES):
            return
        future = self._worker.submit(self._compute, self._fit, task)
        self._computing = task.run, future
        future.add_done_callback(lambda _: self._on_computed())

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _take(self, run: int, done: "Future[_Fit]") -> None:
        try:
            self._guide.use_fit(done.result())
        except Exception:
            # Without a fit page and panel go on: they show the session.
            logging.getLogger(__name__).exception("fit of a guided recording")
            self._failures = self._failures + 1 if run == self._failed_run else 1
            self._failed_run = run
