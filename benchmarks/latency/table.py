"""Results as tables."""

from collections.abc import Iterable

import numpy as np
from rich.table import Table

from app.geometry import FloatArray
from benchmarks.latency.results import Run, mean_or_none
from benchmarks.latency.stops import StopRun

NOTES = """\
Time from the stamp of a frame, made in another process, to the end of the update of the MRML scene
and of all observers. Transport: the part up to the callback in this process. Step: the part up to
the end of the session's step, with a late sender and transport. Picture: to the end of drawing.
Superseded: replaced by a newer frame before it was shown, which is intended. Lock kept: Qt's loop
keeps Python's lock while it waits, as PythonQt in desktop Slicer does; a double of it.
Clock: the machine's own, shared by all processes.
"""


def runs_table(runs: Iterable[Run], title: str) -> Table:
    """One row per receiver, times in ms."""
    table = Table(title=title, title_justify="left")
    table.add_column("receiver", no_wrap=True)
    table.add_column("what")
    for heading in ("mean", "sd", "p50", "p95", "p99", "max", "transport", "step", "picture"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("sent", "shown", "superseded", "lost", "load"):
        table.add_column(heading, justify="right", no_wrap=True)
    for run in runs:
        times = (run.mean_ms, float(run.delays_ms.std()))
        percentiles = (run.percentile_ms(percent) for percent in (50, 95, 99, 100))
        table.add_row(
            run.kind.name,
            run.kind.what,
            *(f"{value:.2f}" for value in (*times, *percentiles)),
            _mean_text(run.transport_ms),
            _mean_text(run.step_ms),
            _mean_text(run.picture_ms),
            str(run.sent),
            str(run.shown),
            str(run.superseded),
            "?" if run.lost is None else str(run.lost),
            f"{run.load:.1f}",
        )
    return table


def stops_table(runs: Iterable[StopRun], title: str) -> Table:
    """One row per robot, times in ms."""
    table = Table(title=title, title_justify="left")
    table.add_column("receiver", no_wrap=True)
    headings = ("stops", "mean", "sd", "max", "all frames: mean", "p99", "picture: mean", "sd")
    for heading in (*headings, "load"):
        table.add_column(heading, justify="right", no_wrap=True)
    for run in runs:
        values = (run.stops_ms.mean(), run.stops_ms.std(), run.stops_ms.max())
        frames = (run.frames_ms.mean(), np.percentile(run.frames_ms, 99))
        has_pictures = len(run.pictures_ms) > 0
        table.add_row(
            run.name,
            str(len(run.stops_ms)),
            *(f"{value:.2f}" for value in (*values, *frames)),
            _mean_text(run.pictures_ms),
            f"{run.pictures_ms.std():.2f}" if has_pictures else "",
            f"{run.load:.1f}",
        )
    return table


def _mean_text(values: FloatArray) -> str:
    mean_ms = mean_or_none(values)
    return "" if mean_ms is None else f"{mean_ms:.2f}"
