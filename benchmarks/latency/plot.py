"""Plots of the results: histogram of the delays, and delay by frame."""

from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.latency.results import Run

_INK = "#1c2733"
_COLORS = ("#d55e00", "#0072b2", "#56b4e9", "#7a5195", "#009e73")
_BINS = 80


def write_plots(runs: Sequence[Run], folder: Path) -> None:
    """Write ``latency_histogram.png`` and ``latency_frames.png``, one panel per receiver."""
    folder.mkdir(parents=True, exist_ok=True)
    # Up to the 99.5th percentile: one frame that is 40 ms late must not compress the rest.
    end_ms = 1.1 * max(run.percentile_ms(99.5) for run in runs)
    for name, label, draw in (
        ("latency_histogram.png", "stamp to scene [ms]", _histogram),
        ("latency_frames.png", "frame, in the order shown", _frames),
    ):
        figure = _figure(runs, end_ms, draw, label)
        FigureCanvasAgg(figure).print_png(folder / name)


def _figure(
    runs: Sequence[Run],
    end_ms: float,
    draw: Callable[[Axes, Run, str, float], None],
    label: str,
) -> Figure:
    figure = Figure(figsize=(9.0, 1.9 * len(runs) + 0.6), dpi=110, layout="constrained")
    panels = figure.subplots(len(runs), 1, squeeze=False)[:, 0]
    for panel, run, color in zip(panels, runs, cycle(_COLORS), strict=False):
        draw(panel, run, color, end_ms)
        beyond = int((run.delays_ms > end_ms).sum())
        panel.set_title(
            f"{run.kind.name}: mean {run.mean_ms:.2f} ms, p99 {run.percentile_ms(99):.2f} ms"
            + (f", {beyond} beyond the picture" if beyond else ""),
            loc="left",
            color=_INK,
            fontsize=10,
            fontweight="bold",
        )
        panel.grid(axis="y", color=_INK, alpha=0.12, lw=0.6)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
    panels[-1].set_xlabel(label, color=_INK)
    return figure


def _histogram(panel: Axes, run: Run, color: str, end_ms: float) -> None:
    panel.hist(run.delays_ms, bins=np.linspace(0.0, end_ms, _BINS + 1), color=color)
    panel.axvline(run.mean_ms, color=_INK, lw=1.2, ls="--")
    panel.set_xlim(0.0, end_ms)
    panel.set_ylabel("frames", color=_INK)


def _frames(panel: Axes, run: Run, color: str, end_ms: float) -> None:
    panel.plot(run.delays_ms, ".", ms=2.0, color=color)
    panel.axhline(run.mean_ms, color=_INK, lw=1.2, ls="--")
    panel.set_xlim(0, max(1, run.shown - 1))
    panel.set_ylim(0.0, end_ms)
    panel.set_ylabel("ms", color=_INK)
