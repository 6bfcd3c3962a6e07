"""Computes the fits of a guided calibration or registration beside the page's thread."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, Protocol, TypeVar

from app.geometry import MarginGuardError
from app.runtime import Compute
from app.viewer.log import log

_Task = TypeVar("_Task")
_Fit = TypeVar("_Fit")
_TaskOut = TypeVar("_TaskOut", covariant=True)
_FitIn = TypeVar("_FitIn", contravariant=True)


class Guide(Protocol[_TaskOut, _FitIn]):
    """What is to be fitted, and where the result goes."""

    def task(self) -> _TaskOut | None:
        """The next task, None while there is none."""

    def use_fit(self, fit: _FitIn, /) -> None:
        """Take a result."""


class GuidedFits(Generic[_Task, _Fit]):
    """One fit at a time. The page's thread owns it.

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
        self._computing: Future[_Fit] | None = None

    @property
    def is_done(self) -> bool:
        """True if a result waits for `follow`."""
        return self._computing is not None and self._computing.done()

    def follow(self) -> None:
        """Take a result that is done, and begin the next task."""
        if self._computing is not None and self._computing.done():
            done, self._computing = self._computing, None
            try:
                self._guide.use_fit(done.result())
            except MarginGuardError:
                # The computing process has ended; another one takes the next task.
                log.exception("guided fit")
        task = None if self._computing is not None else self._guide.task()
        if task is not None:
            self._computing = self._worker.submit(self._compute, self._fit, task)
            self._computing.add_done_callback(lambda _: self._on_computed())

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)
