"""Plots of the results: the delays of each receiver, and the delays at the stops of a robot."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness.figures import percentiles
from benchmarks.harness.plots import INK, new_figure, open_axes, write_png
from benchmarks.latency.results import Run
from benchmarks.latency.stops import StopRun

DELAYS, STOPS = "latency.png", "latency_stops.png"
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#7a5195", "#56b4e9", "#b07d00")
_BINS = 120


def write_plots(runs: Sequence[Run], stops: Sequence[StopRun], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in ((DELAYS, _delays(runs)), (STOPS, _stops(stops))):
        write_png(figure, folder / name)


def _delays(runs: Sequence[Run]) -> Figure:
    """A histogram for each receiver, on one logarithmic axis."""
    end_ms = 1.2 * max(percentiles(run.delays_ms, 99.5)[0] for run in runs)
    begin_ms = 0.8 * min(float(run.delays_ms.min()) for run in runs)
    bins = np.geomspace(max(begin_ms, 0.05), end_ms, _BINS + 1)
    figure = new_figure(8.0, 0.62 * len(runs) + 0.7)
    panels = figure.subplots(len(runs), 1, sharex=True, squeeze=False)[:, 0]
    for panel, run, color in zip(panels, runs, cycle(_COLORS), strict=False):
        panel.hist(run.delays_ms, bins=bins, color=color)
        panel.axvline(run.mean_ms, color=INK, lw=1.0, ls="--")
        panel.set_xscale("log")
        panel.set_yticks([])
        (p99,) = percentiles(run.delays_ms, 99)
        text = f"{run.name}\nmean {run.mean_ms:.2f}, p99 {p99:.2f} ms"
        panel.set_ylabel(text, rotation=0, ha="right", va="center", color=INK, fontsize=8)
        open_axes(panel, ("top", "right", "left"))
    panels[-1].set_xlabel("stamp to scene [ms]; dashed: the mean", color=INK)
    panels[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    return figure


def _stops(runs: Sequence[StopRun]) -> Figure:
    """The delay at each stop, with mean and standard deviation."""
    series = [(run.name, run.stops_ms) for run in runs]
    series += [(f"{run.name}: picture", run.pictures_ms) for run in runs if len(run.pictures_ms)]
    figure = new_figure(8.0, 0.42 * len(series) + 0.9)
    axes = figure.subplots()
    for row, ((_, values), color) in enumerate(zip(series, cycle(_COLORS), strict=False)):
        spread = np.linspace(-0.22, 0.22, len(values))
        axes.plot(values, row + spread, "o", ms=3.5, color=color, alpha=0.75)
        mean, deviation = float(values.mean()), float(values.std())
        axes.errorbar(mean, row, xerr=deviation, color=INK, capsize=3, lw=1.2, fmt="|", ms=12)
    names = [
        f"{name}\n{values.mean():.2f} \N{PLUS-MINUS SIGN} {values.std():.2f} ms"
        for name, values in series
    ]
    axes.set_yticks(range(len(series)), names, fontsize=8, color=INK)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel("delay at a stop [ms]; bar: mean and standard deviation", color=INK)
    axes.grid(axis="x", color=INK, alpha=0.12, lw=0.6)
    open_axes(axes, ("top", "right", "left"))
    return figure
