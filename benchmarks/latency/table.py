"""The results as text."""

from collections.abc import Iterable

from rich.table import Table

from benchmarks.latency.results import Run

NOTES = """\
From the stamp of a frame's first body, made in another process, to the moment when all models of
the scene are moved and every observer has been called; drawing is not part of it. Superseded: a
newer frame was there first, as wanted where nobody waits. Late: shown when the next frame had
been sent already. Clock: the machine's own, one for all processes.
"""


def runs_table(runs: Iterable[Run], title: str) -> Table:
    """A line a way, times in ms."""
    table = Table(title=title, title_justify="left")
    table.add_column("way", no_wrap=True)
    table.add_column("what")
    for heading in ("sent", "shown", "mean", "sd", "p50", "p95", "p99", "max"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("superseded", "late", "lost", "load"):
        table.add_column(heading, justify="right", no_wrap=True)
    for run in runs:
        times = (run.mean_ms, float(run.delays_ms.std()))
        percentiles = (run.percentile_ms(percent) for percent in (50, 95, 99, 100))
        table.add_row(
            run.kind.name,
            run.kind.what,
            str(run.sent),
            str(run.shown),
            *(f"{value:.2f}" for value in (*times, *percentiles)),
            str(run.superseded),
            str(run.late),
            "?" if run.lost is None else str(run.lost),
            f"{run.load:.1f}",
        )
    return table
