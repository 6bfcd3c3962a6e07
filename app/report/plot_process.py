"""Draws ``margin.png`` in another process, while this one analyses the replay."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

from app.analysis.breaches import find_breaches
from app.fixture import MarginParameters
from app.geometry import InputError
from app.report.record import ReplayRecord
from app.report.rows import ReportRow
from app.runtime import ComputeProcess


@contextmanager
def margin_plot_process(record: ReplayRecord) -> Iterator[Callable[[], bytes]]:
    """Begin to draw ``margin.png``; the value of the context waits for it.

    matplotlib takes longer to load than the plot to draw, and this process is busy with other
    Python code meanwhile. If the other process is killed, the plot is drawn here. Raises
    `ReportError` for a replay without frames.
    """
    record.require_frames()
    draw = partial(draw_margin_plot, record.rows, record.margins, record.case)
    with ThreadPoolExecutor(max_workers=1) as waiting, ComputeProcess() as process:
        drawn = waiting.submit(process.call, draw)

        def wait() -> bytes:
            try:
                return drawn.result()
            except InputError:  # the process has ended
                return draw()

        yield wait


def draw_margin_plot(rows: Sequence[ReportRow], margins: MarginParameters, title: str) -> bytes:
    """The PNG of `app.report.margin_plot.margin_png`, which loads matplotlib."""
    from app.report.margin_plot import margin_png

    return margin_png(rows, find_breaches(rows, margins.stale_after_ns), margins, title)
