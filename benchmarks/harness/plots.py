"""Plots of figures as PNG files in one style."""

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.geometry import FloatArray
from benchmarks.harness.figures import percentiles

INK = "#1c2733"
COLORS = ("#0072b2", "#d55e00", "#009e73", "#7a5195", "#56b4e9", "#b07d00", "#8c8c8c", "#7fc8a9")
_BINS = 120

Times = dict[str, list[tuple[float, float, float]]]  # by engine: size, p50, p99 in ms


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), dpi=100, layout="constrained")


def _write(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(path)


def write_histograms(path: Path, delays_ms: Mapping[str, FloatArray], label: str) -> None:
    """A histogram for each name, on one logarithmic axis with the ``label``."""
    end_ms = 1.2 * max(percentiles(each, 99.5)[0] for each in delays_ms.values())
    begin_ms = 0.8 * min(float(each.min()) for each in delays_ms.values())
    bins = np.geomspace(max(begin_ms, 0.05), end_ms, _BINS + 1)
    figure = _figure(8.0, 0.62 * len(delays_ms) + 0.7)
    panels = figure.subplots(len(delays_ms), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (name, values), color in zip(panels, delays_ms.items(), cycle(COLORS), strict=False):
        panel.hist(values, bins=bins, color=color)
        panel.axvline(values.mean(), color=INK, lw=1.0, ls="--")
        panel.set_xscale("log")
        panel.set_yticks([])
        text = f"{name}\nmean {values.mean():.2f}, p99 {percentiles(values, 99)[0]:.2f} ms"
        panel.set_ylabel(text, rotation=0, ha="right", va="center", color=INK, fontsize=8)
        panel.spines[["top", "right", "left"]].set_visible(False)
    panels[-1].set_xlabel(label, color=INK)
    panels[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    _write(figure, path)


def write_dots(path: Path, delays_ms: Mapping[str, FloatArray], label: str) -> None:
    """Each delay of each name, with mean and standard deviation."""
    figure = _figure(8.0, 0.42 * len(delays_ms) + 0.9)
    axes, names = figure.subplots(), []
    for row, ((name, values), color) in enumerate(
        zip(delays_ms.items(), cycle(COLORS), strict=False)
    ):
        spread = np.linspace(-0.22, 0.22, len(values))
        axes.plot(values, row + spread, "o", ms=3.5, color=color, alpha=0.75)
        mean, deviation = float(values.mean()), float(values.std())
        axes.errorbar(mean, row, xerr=deviation, color=INK, capsize=3, lw=1.2, fmt="|", ms=12)
        names.append(f"{name}\n{mean:.2f} \N{PLUS-MINUS SIGN} {deviation:.2f} ms")
    axes.set_yticks(range(len(names)), names, fontsize=8, color=INK)
    axes.invert_yaxis()
    axes.set_xlim(left=0.0)
    axes.set_xlabel(label, color=INK)
    axes.grid(axis="x", color=INK, alpha=0.12, lw=0.6)
    axes.spines[["top", "right", "left"]].set_visible(False)
    _write(figure, path)


def write_lines(path: Path, panels: Mapping[str, Times], label: str, bold: str) -> None:
    """Time over size, both logarithmic, p50 solid and p99 dashed; one panel for each title.

    Lines of engines whose name starts with ``bold`` are thicker.
    """
    figure = _figure(4.6 * len(panels) + 2.4, 5.6)
    names = dict.fromkeys(name for times in panels.values() for name in times)
    colors = dict(zip(names, cycle(COLORS), strict=False))
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (title, times) in zip(all_axes, panels.items(), strict=True):
        for name, rows in times.items():
            sizes, *percents = zip(*rows, strict=True)
            width = 2.6 if name.startswith(bold) else 1.4
            for style, ms in zip(("-", "--"), percents, strict=True):
                axes.plot(sizes, ms, style, color=colors[name], lw=width, marker="o", ms=3)
        axes.axhline(1.0, color=INK, lw=0.8, ls=":")
        axes.set_xscale("log")
        axes.set_yscale("log")
        ticks = sorted({row[0] for rows in times.values() for row in rows})
        axes.set_xticks(ticks, [_short(each) for each in ticks])
        axes.minorticks_off()
        axes.set_title(title, loc="left", color=INK, fontsize=11)
        axes.set_xlabel(label, color=INK)
        axes.grid(color=INK, alpha=0.12, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    all_axes[0].set_ylabel("ms per pose", color=INK)
    handles = [Line2D([], [], color=color, lw=2, label=name) for name, color in colors.items()]
    for style, text in (("-", "p50"), ("--", "p99"), (":", "1 ms: 1 kHz")):
        handles.append(Line2D([], [], color=INK, ls=style, label=text))
    figure.legend(handles=handles, loc="outside right center", frameon=False)
    _write(figure, path)


def _short(count: float) -> str:
    if count < 1000:
        return f"{count:g}"
    return f"{count / 1e6:.1f}M" if count >= 1_000_000 else f"{count / 1000:.0f}k"
