"""Plots by matplotlib: the signed distance over time, for ``margin.png`` and the PDF; residuals.

Uses matplotlib's objects on an Agg canvas instead of pyplot, which would change global state.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from app.analysis.samples import Breach
from app.fixture import MarginParameters, MarginState
from app.geometry import FloatArray
from app.report.page import BREACH, DROPPED, HATCH, INK, USED
from app.report.rows import ReportError, ReportRow
from app.report.time_plot import TIME_LABEL, TimePlot, distance_plot, spread

_SIZE_INCHES = (13.0, 6.0)
_DPI = 120
_NAME_FRACTION = 0.07
"""Fraction of the plot's width from which on a band is labelled with the name of its state."""
_BAND_ALPHA = 0.16
_LABEL_POINTS = 14.0
"""Height of the name of a line."""
_PLOT_POINTS = 0.75 * 72.0 * _SIZE_INCHES[1]
"""About the height of the plot: at most its true one, so that names have more room."""
_LABEL_WIDTH = 0.08
"""Width of the text of a breach as a share of the time axis."""
_BOX: Any = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75}
"""Ground of a text over curves."""


def margin_png(
    rows: Sequence[ReportRow], breaches: Sequence[Breach], margins: MarginParameters, title: str
) -> bytes:
    """Draw the plot; return it as PNG, 1560 x 720 pixels."""
    return figure_png(margin_figure(rows, breaches, margins, title))


def figure_png(figure: Figure) -> bytes:
    """Draw ``figure``; return it as PNG."""
    canvas: Any = FigureCanvasAgg(figure)  # without annotations
    canvas.draw()  # `Figure.savefig` would draw everything twice, the first time for the layout
    picture = BytesIO()
    # Without the version of matplotlib equal rows give equal bytes on one machine.
    metadata: Any = {"Software": None}
    imsave(picture, canvas.buffer_rgba(), format="png", dpi=figure.dpi, metadata=metadata)
    return picture.getvalue()


def margin_figure(
    rows: Sequence[ReportRow], breaches: Sequence[Breach], margins: MarginParameters, title: str
) -> Figure:
    """Draw the plot of ``rows``, at least one."""
    figure = Figure(figsize=_SIZE_INCHES, dpi=_DPI, layout="constrained")
    strip, plot = figure.subplots(2, 1, sharex=True, height_ratios=(1, 16))
    figure.suptitle(
        title, x=0.012, ha="left", color=INK, fontsize=14, fontweight="bold", parse_math=False
    )
    content = distance_plot(rows, breaches, margins)
    _draw_states(strip, plot, content)
    _draw_curves(plot, content)
    _set_limits(plot, content)
    _label_lines(plot, content)
    _draw_breaches(plot, content, breaches)
    _draw_legend(figure, strip, plot)
    return figure


def _draw_states(strip: Axes, plot: Axes, content: TimePlot) -> None:
    whole_s = float(content.times_s[-1] - content.times_s[0])
    spans: dict[MarginState, list[tuple[float, float]]] = {}
    for band in content.bands:
        length_s = band.end_s - band.start_s
        spans.setdefault(band.state, []).append((band.start_s, length_s))
        if length_s > _NAME_FRACTION * whole_s:
            strip.text(
                band.start_s + 0.5 * length_s, 0.5, band.label,
                transform=strip.get_xaxis_transform(), ha="center", va="center",
                color=band.state.display.text_color, fontsize=9, fontweight="bold",
            )  # fmt: skip
    # One collection per state: half an hour has hundreds of bands.
    for state, bands in spans.items():
        color = state.display.color
        strip.broken_barh(
            bands, (0.0, 1.0), transform=strip.get_xaxis_transform(), facecolor=color, lw=0
        )
        plot.broken_barh(
            bands, (0.0, 1.0), transform=plot.get_xaxis_transform(), facecolor=color,
            alpha=_BAND_ALPHA, lw=0, hatch=state.display.hatch, edgecolor=HATCH, zorder=0,
        )  # fmt: skip
    strip.set_ylim(0.0, 1.0)
    strip.set_yticks([])
    strip.tick_params(bottom=False, labelbottom=False)
    strip.set_ylabel("state", rotation=0, ha="right", va="center", color=INK)
    for side in strip.spines.values():
        side.set_visible(False)


def _draw_curves(plot: Axes, content: TimePlot) -> None:
    for series in content.series:  # NaN interrupts a line where nothing was measured
        plot.plot(
            content.times_s, series.values, color=series.color, lw=series.width,
            ls=":" if series.dash else "-", label=series.label, zorder=4,
        )  # fmt: skip
    for line in content.lines:
        style: dict[str, Any] = {"lw": 1.2, "ls": (0, (6, 4))} if line.value else {"lw": 1.0}
        plot.axhline(line.value, color=line.color, zorder=3, **style)
    plot.set_ylabel(content.label, color=INK)
    plot.set_xlabel(TIME_LABEL, color=INK)
    plot.grid(axis="y", color=INK, alpha=0.10, lw=0.6)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)


def _label_lines(plot: Axes, content: TimePlot) -> None:
    """Names of the lines on the right, beside each other's; the limits are set."""
    low, high = plot.get_ylim()
    points_per_mm = _PLOT_POINTS / (high - low)
    # The name of the surface is below its line.
    below = [0.0 if line.value else _LABEL_POINTS for line in content.lines]
    wished = [
        under - line.value * points_per_mm for line, under in zip(content.lines, below, strict=True)
    ]
    placed = spread(wished, _LABEL_POINTS, -high * points_per_mm)
    for line, under, wish, place in zip(content.lines, below, wished, placed, strict=True):
        plot.annotate(
            line.label, (1.0, line.value), (6, wish - place - under),
            xycoords=("axes fraction", "data"), textcoords="offset points", va="bottom",
            color=line.color, fontsize=10, annotation_clip=False,
        )  # fmt: skip


def _set_limits(plot: Axes, content: TimePlot) -> None:
    seconds, distances, top = content.times_s, content.series[-1].values, content.top
    known = distances[np.isfinite(distances)]
    low = min(float(known.min(initial=0.0)), 0.0)
    # Room below the deepest point for its label.
    plot.set_ylim(low - 0.16 * (top - low), top)
    plot.set_xlim(float(seconds[0]), max(float(seconds[-1]), float(seconds[0]) + 1e-3))
    if len(known) and float(known.max()) > top:
        plot.annotate(
            f"distances above {top:g} mm are not drawn", (1.0, 1.0), (-4, -4),
            xycoords="axes fraction", textcoords="offset points", ha="right", va="top",
            fontsize=9, color=INK, zorder=8, bbox=_BOX,
        )  # fmt: skip


def _draw_breaches(plot: Axes, content: TimePlot, breaches: Sequence[Breach]) -> None:
    bottom = plot.get_ylim()[0]
    color = MarginState.POSITIVE.display.color
    middles = [0.5 * (mark.start_s + mark.end_s) for mark in content.marks]
    near_s = _LABEL_WIDTH * float(content.times_s[-1] - content.times_s[0])
    following = [*middles, float("inf")][1:]
    for mark, breach, middle_s, next_s in zip(
        content.marks, breaches, middles, following, strict=True
    ):
        # The text of a breach shortly before another one ends at it, to leave place for the other.
        align = "right" if next_s - middle_s < near_s else "center"
        depth = breach.min_signed_distance_mm
        plot.plot(
            [mark.start_s, mark.end_s], [bottom, bottom], color=color, lw=7,
            solid_capstyle="butt", marker="|", ms=9, clip_on=False, zorder=6,
        )  # fmt: skip
        plot.annotate(
            f"{mark.label}\n\N{MINUS SIGN}{-depth:.2f} mm", (middle_s, depth), (0, -9),
            textcoords="offset points", ha=align, va="top", fontsize=10, fontweight="bold",
            color=BREACH, zorder=7, linespacing=1.15, bbox=_BOX,
        )  # fmt: skip


def _draw_legend(figure: Figure, strip: Axes, plot: Axes) -> None:
    states = [
        Patch(facecolor=state.color, hatch=state.display.hatch, edgecolor=HATCH, lw=0)
        for state in MarginState
    ]
    names = [
        f"{state.display.symbol} {state.name}: {state.display.description}" for state in MarginState
    ]
    lines, labels = plot.get_legend_handles_labels()
    figure.legend(
        handles=[*states, *lines],
        labels=[*names, *labels],
        loc="outside lower left",
        ncols=len(states) + len(lines),
        frameon=False,
        fontsize=8.5,
        labelcolor=INK,
        handlelength=1.4,
        columnspacing=1.0,
    )


_RESIDUAL_SIZE_INCHES = (10.0, 4.5)


def residual_png(
    values: FloatArray,
    *,
    title: str,
    what: str,
    unit: str,
    across: str,
    labels: Sequence[str] = (),
    outliers: Sequence[int] = (),
) -> bytes:
    """Draw a bar for each of ``values`` (n,) in ``unit``; return a PNG of 1200 x 540 pixels.

    ``across`` is the label of the x axis. ``labels`` names the bars; without it they are numbered
    from 1. ``outliers`` are the indices of dropped values: hatched, and not in the RMS. Raises
    `ReportError` without values.
    """
    if not len(values):
        raise ReportError("residuals: 0 values; expected at least 1")
    dropped = np.isin(np.arange(len(values)), np.asarray(outliers, dtype=int))
    figure = Figure(figsize=_RESIDUAL_SIZE_INCHES, dpi=_DPI, layout="constrained")
    plot = figure.subplots()
    plot.set_title(title, loc="left", color=INK, fontsize=13, fontweight="bold", parse_math=False)
    places = np.arange(1, len(values) + 1)
    plot.bar(places[~dropped], values[~dropped], color=USED, label="used")
    if dropped.any():
        plot.bar(
            places[dropped], values[dropped], color="white", edgecolor=DROPPED, hatch="////",
            label=f"dropped: {int(dropped.sum())}",
        )  # fmt: skip
    if not dropped.all():
        rms = float(np.sqrt(np.mean(values[~dropped] ** 2)))
        plot.axhline(rms, color=INK, ls=(0, (6, 4)), lw=1.2, label=f"RMS {rms:.3g} {unit}")
    if labels:
        plot.set_xticks(places, labels, parse_math=False)
    else:
        plot.xaxis.set_major_locator(MaxNLocator(integer=True))
    plot.set_xlabel(across, color=INK, fontsize=9)
    plot.set_ylabel(f"{what} [{unit}]", color=INK, fontsize=9)
    plot.margins(y=0.16)  # space for the legend above the bars
    plot.set_ylim(bottom=0.0)
    plot.grid(axis="y", color=INK, alpha=0.10, lw=0.6)
    plot.set_axisbelow(True)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)
    plot.legend(frameon=False, fontsize=9, labelcolor=INK, loc="upper right", ncols=3)
    return figure_png(figure)
