"""``margin.png``: signed distance over time, with states as background and breaches marked.

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

from app.analysis.breaches import Breach
from app.fixture import MarginParameters, MarginState
from app.geometry import FloatArray
from app.report.colors import BREACH, HATCH, INK, STOP, WARN
from app.report.label_layout import spread
from app.report.rows import ReportRow, played_seconds, state_bands

_SIZE_INCHES = (13.0, 6.0)
_DPI = 120
_NAME_FRACTION = 0.07
"""Fraction of the plot's width from which on a band is labelled with the name of its state."""
_SHOWN_TIMES_WARN = 5.0
"""The plot reaches up to this many warning distances."""
_BAND_ALPHA = 0.16
_LABEL_POINTS = 14.0
"""Height of the name of a line."""
_PLOT_POINTS = 0.75 * 72.0 * _SIZE_INCHES[1]
"""About the height of the plot: at most its true one, so that names have more room."""
_LABEL_WIDTH = 0.08
"""Width of the text of a breach as a share of the time axis."""


def margin_png(
    rows: Sequence[ReportRow], breaches: Sequence[Breach], margins: MarginParameters, title: str
) -> bytes:
    """Draw the plot; return it as PNG, 1560 x 720 pixels."""
    figure = margin_figure(rows, breaches, margins, title)
    canvas: Any = FigureCanvasAgg(figure)  # without annotations
    canvas.draw()  # `Figure.savefig` would draw everything twice, the first time for the layout
    picture = BytesIO()
    # Without the version of matplotlib equal rows give equal bytes on one machine.
    metadata: Any = {"Software": None}
    imsave(picture, canvas.buffer_rgba(), format="png", dpi=_DPI, metadata=metadata)
    return picture.getvalue()


def margin_figure(
    rows: Sequence[ReportRow], breaches: Sequence[Breach], margins: MarginParameters, title: str
) -> Figure:
    """Draw the plot of ``rows``, at least one, on an Agg canvas."""
    figure = Figure(figsize=_SIZE_INCHES, dpi=_DPI, layout="constrained")
    strip, plot = figure.subplots(2, 1, sharex=True, height_ratios=(1, 16))
    figure.suptitle(
        title, x=0.012, ha="left", color=INK, fontsize=14, fontweight="bold", parse_math=False
    )
    # A clock that jumps back would fold the plot over itself.
    seconds = played_seconds(rows)
    _draw_states(strip, plot, rows, seconds)
    _draw_distance(plot, rows, seconds)
    _draw_margins(plot, rows, seconds, margins)
    _draw_limits(plot, rows, seconds, margins)
    _label_margins(plot, margins)
    _draw_breaches(plot, breaches, rows, seconds)
    _draw_legend(figure, strip, plot)
    FigureCanvasAgg(figure)
    return figure


def _draw_states(strip: Axes, plot: Axes, rows: Sequence[ReportRow], seconds: FloatArray) -> None:
    whole_s = float(seconds[-1] - seconds[0])
    spans: dict[MarginState, list[tuple[float, float]]] = {}
    for state, start_s, end_s in state_bands(rows, seconds):
        spans.setdefault(state, []).append((start_s, end_s - start_s))
        if end_s - start_s > _NAME_FRACTION * whole_s:
            strip.text(
                0.5 * (start_s + end_s), 0.5, f"{state.display.symbol} {state.name}",
                transform=strip.get_xaxis_transform(), ha="center", va="center",
                color=state.display.text_color, fontsize=9, fontweight="bold",
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


def _draw_distance(plot: Axes, rows: Sequence[ReportRow], seconds: FloatArray) -> None:
    # NaN interrupts the line where no distance was measured.
    lower = _column([row.lower_bound_mm for row in rows])
    distance = _column([row.signed_distance_mm for row in rows])
    plot.plot(seconds, lower, color=INK, lw=0.7, alpha=0.35, label="lower bound")
    plot.plot(seconds, distance, color=INK, lw=1.5, label="signed distance", zorder=4)
    plot.set_ylabel("signed distance, tool to tumour [mm]", color=INK)
    plot.set_xlabel("time from the first frame [s]", color=INK)
    plot.grid(axis="y", color=INK, alpha=0.10, lw=0.6)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)


def _draw_margins(
    plot: Axes, rows: Sequence[ReportRow], seconds: FloatArray, margins: MarginParameters
) -> None:
    # While the state is UNKNOWN the margin grows with the age of the data: it is not drawn.
    known = np.array([row.state is not MarginState.UNKNOWN for row in rows])
    warn_total, stop_total = (
        np.where(known, _column(totals), np.nan)
        for totals in ([row.warn_total_mm for row in rows], [row.stop_total_mm for row in rows])
    )
    for name, nominal_mm, applied, color in (
        ("warn", margins.warn_mm, warn_total, WARN),
        ("stop", margins.stop_mm, stop_total, STOP),
    ):
        plot.axhline(nominal_mm, color=color, lw=1.2, ls=(0, (6, 4)), zorder=3)
        plot.plot(seconds, applied, color=color, lw=0.9, ls=":", zorder=3, label=f"applied {name}")
    plot.axhline(0.0, color=INK, lw=1.0, zorder=3)


def _label_margins(plot: Axes, margins: MarginParameters) -> None:
    """Names of the lines on the right, beside each other's; the limits are set."""
    low, high = plot.get_ylim()
    points_per_mm = _PLOT_POINTS / (high - low)
    lines = (
        (margins.warn_mm, f"warn {margins.warn_mm:g}", WARN),
        (margins.stop_mm, f"stop {margins.stop_mm:g}", STOP),
        (0.0, "surface", INK),
    )
    wished = [-height * points_per_mm for height, _, _ in lines]
    # The name of the surface is below its line.
    wished[-1] += _LABEL_POINTS
    placed = spread(wished, _LABEL_POINTS, -high * points_per_mm)
    for (height, text, color), wish, place in zip(lines, wished, placed, strict=True):
        offset = wish - place - (_LABEL_POINTS if height == 0.0 else 0.0)
        plot.annotate(
            text, (1.0, height), (6, offset), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="bottom", color=color, fontsize=10,
            annotation_clip=False,
        )  # fmt: skip


def _draw_limits(
    plot: Axes, rows: Sequence[ReportRow], seconds: FloatArray, margins: MarginParameters
) -> None:
    distances = _column([row.signed_distance_mm for row in rows])
    known = distances[np.isfinite(distances)]
    top = _SHOWN_TIMES_WARN * margins.warn_mm
    deepest = float(known.min()) if len(known) else 0.0
    # Room below the deepest point for its label.
    plot.set_ylim(min(deepest, 0.0) - 0.16 * (top - min(deepest, 0.0)), top)
    plot.set_xlim(float(seconds[0]), max(float(seconds[-1]), float(seconds[0]) + 1e-3))
    if len(known) and float(known.max()) > top:
        plot.annotate(
            f"distances above {top:g} mm are not drawn", (1.0, 1.0), (-4, -4),
            xycoords="axes fraction", textcoords="offset points", ha="right", va="top",
            fontsize=9, color=INK, zorder=8,
            bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75},
        )  # fmt: skip


def _draw_breaches(
    plot: Axes, breaches: Sequence[Breach], rows: Sequence[ReportRow], seconds: FloatArray
) -> None:
    bottom = plot.get_ylim()[0]
    color = MarginState.POSITIVE.display.color
    ends = [(float(seconds[each.first]), float(seconds[each.last])) for each in breaches]
    middles = [0.5 * (start_s + end_s) for start_s, end_s in ends]
    near_s = _LABEL_WIDTH * float(seconds[-1] - seconds[0])
    for number, breach in enumerate(breaches, start=1):
        start_s, end_s = ends[number - 1]
        middle_s = middles[number - 1]
        # The text of a breach shortly before another one ends at it, to leave place for the other.
        is_close = number < len(middles) and middles[number] - middle_s < near_s
        depth = breach.min_signed_distance_mm
        plot.plot(
            [start_s, end_s], [bottom, bottom], color=color, lw=7,
            solid_capstyle="butt", marker="|", ms=9, clip_on=False, zorder=6,
        )  # fmt: skip
        plot.annotate(
            f"breach {number}\n\N{MINUS SIGN}{-depth:.2f} mm", (middle_s, depth), (0, -9),
            textcoords="offset points", ha="right" if is_close else "center", va="top",
            fontsize=10, fontweight="bold", color=BREACH, zorder=7, linespacing=1.15,
            bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.75},
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


def _column(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
