"""Results as a table."""

from collections.abc import Iterable

from rich.table import Table

from benchmarks.latency.results import Run

NOTES = """\
Time from the stamp of a frame's first body, made in another process, to the end of the update of
all models in the scene and of all observers; rendering is not part of it. Superseded: replaced by
a newer frame before it was shown, which is intended. Late: shown after the next frame was sent.
Clock: the machine's own, shared by all processes.
"""


def runs_table(runs: Iterable[Run], title: str) -> Table:
    """One row per receiver, times in ms."""
    table = Table(title=title, title_justify="left")
    table.add_column("receiver", no_wrap=True)
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
