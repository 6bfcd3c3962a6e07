"""Makes parts of a report in another process, while this one replays and analyses."""

import gc
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from importlib import import_module
from typing import Any, Generic, Self, TypeVar

from app.analysis.samples import find_breaches
from app.fixture import MarginParameters
from app.geometry import InputError
from app.report.record import ReplayRecord
from app.report.rows import ReportRow
from app.runtime import ComputeProcess

_Value = TypeVar("_Value")


class ReportPart(Generic[_Value]):
    """A part that is being made: `wait` returns it, ``processor_s`` is then the time it took."""

    def __init__(self, future: "Future[tuple[_Value, float]]", here: Callable[[], _Value]) -> None:
        self._future = future
        self._here = here
        self.processor_s = 0.0

    def wait(self) -> _Value:
        """The result, or its `MarginGuardError`; `RuntimeError` for another error."""
        value, self.processor_s = self._future.result()
        return value

    def wait_or_make(self) -> _Value:
        """Wait like `wait`, but make the part here if the process was killed."""
        try:
            return self.wait()
        except InputError:
            return self._here()


class ReportProcess:
    """Makes one part after the other in a process of its own, in the order of `begin`.

    The process starts with the context and loads ``modules``, which takes longer than a part:
    matplotlib takes longer to load than a plot to draw. It ends with the context.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        self._modules = tuple(modules)

    def __enter__(self) -> Self:
        self._process = ComputeProcess()
        self._waiting = ThreadPoolExecutor(max_workers=1)
        self._waiting.submit(self._process.call, _load, self._modules)
        return self

    def __exit__(self, *_: object) -> None:
        self._process.close()
        self._waiting.shutdown(cancel_futures=True)

    def begin(
        self, function: Callable[..., _Value], arguments: Callable[[], Sequence[Any]]
    ) -> ReportPart[_Value]:
        """Make ``function(*arguments())``; ``arguments`` is called in a thread and may wait."""

        def make() -> tuple[_Value, float]:
            return self._process.call(_timed, function, tuple(arguments()))

        return ReportPart(self._waiting.submit(make), lambda: function(*arguments()))

    def begin_margin_plot(self, record: ReplayRecord) -> ReportPart[bytes]:
        """Draw ``margin.png``. Raises `ReportError` for a replay without frames."""
        record.require_frames()
        return self.begin(draw_margin_plot, lambda: (record.rows, record.margins, record.case))


def draw_margin_plot(rows: Sequence[ReportRow], margins: MarginParameters, title: str) -> bytes:
    """The PNG of `app.report.margin_plot.margin_png`, which loads matplotlib."""
    from app.report.margin_plot import margin_png

    return margin_png(rows, find_breaches(rows, margins.stale_after_ns), margins, title)


def _load(modules: Sequence[str]) -> None:
    gc.disable()  # the process ends after a few parts: see `_timed`
    for module in modules:
        with suppress(ImportError):  # reported by the part that needs it
            import_module(module)
    gc.freeze()


def _timed(function: Callable[..., _Value], arguments: Sequence[Any]) -> tuple[_Value, float]:
    """The result of ``function`` and the processor time in s that it took."""
    began_s = time.process_time()
    result = function(*arguments)
    gc.freeze()  # what is left of a part is little; to look through it takes longer than to draw
    return result, time.process_time() - began_s
