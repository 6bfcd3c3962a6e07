"""Plots as SVG, without a script: curves over time, and how long the tool was at each distance."""

import math
from dataclasses import dataclass
from html import escape

import numpy as np

from app.geometry import FloatArray
from app.report.page import CLEAR_BAR, INK, INSIDE_BAR, LINE, STOP_BAR, WARN_BAR
from app.report.time_plot import TimePlot, extremes, spread

MAX_POINTS = 2000
MAX_MM = 30.0
"""Larger distances are left out; the caption says how long they lasted."""
_LABEL_STEP = 15.0


@dataclass(frozen=True, slots=True)
class _Area:
    """Size of a figure, and the edges of the area in it where data are drawn."""

    width: float
    height: float
    left: float
    right: float
    top: float
    bottom: float

    def axis_label(self, text: str) -> str:
        return _text((self.left + self.right) / 2.0, self.height - 8.0, text, "middle")


_TIME = _Area(900.0, 300.0, left=60.0, right=888.0, top=20.0, bottom=254.0)
_HISTOGRAM = _Area(640.0, 260.0, left=54.0, right=628.0, top=14.0, bottom=214.0)


def time_svg(plot: TimePlot, title: str) -> str:
    """The curves and lines of ``plot``, without its bands."""
    area, times = _TIME, plot.times_s
    first, last = float(times[0]), max(float(times[-1]), float(times[0]) + 1e-3)
    low, high = plot.limits or _limits(plot)

    def x(time_s: float) -> float:
        return area.left + (time_s - first) / (last - first) * (area.right - area.left)

    def y(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return area.bottom - share * (area.bottom - area.top)

    def level(value: float, color: str, dash: str = "") -> str:
        return _line(area.left, y(value), area.right, y(value), color, dash=dash)

    parts = [svg_head(area.width, area.height, title)]
    for value in _ticks(low, high):
        parts.append(level(value, LINE))
        parts.append(_text(area.left - 6.0, y(value) + 4.0, f"{value:g}", "end"))
    parts.extend(
        _text(x(time_s), area.bottom + 18.0, f"{time_s:g}", "middle")
        for time_s in _ticks(first, last)
    )
    lines = [line for line in plot.lines if low <= line.value <= high]
    parts.extend(level(line.value, line.color, "6 4") for line in lines)
    for series in plot.series:
        chosen = extremes(series.values, MAX_POINTS)
        known = np.isfinite(series.values[chosen])
        for run in np.split(chosen, np.flatnonzero(np.diff(known.astype(int))) + 1):
            if np.isfinite(series.values[run[0]]):
                places = zip(times[run].tolist(), series.values[run].tolist(), strict=True)
                points = " ".join(f"{x(t):.1f},{y(value):.1f}" for t, value in places)
                parts.append(
                    f'<polyline points="{points}" fill="none" stroke="{series.color}" '
                    f'stroke-width="{series.width:g}"/>'
                )
    heights = spread([y(line.value) - 3.0 for line in lines], _LABEL_STEP, area.top + 10.0)
    parts.append('<g stroke="#fff" stroke-width="3" paint-order="stroke">')  # curves may cross them
    for line, at in zip(lines, heights, strict=True):
        parts.append(_text(area.right - 4.0, at, line.label, "end", line.color))
    parts.append("</g>")
    parts.append(area.axis_label(plot.x_label))
    parts.append(_text(area.left, area.top - 4.0, plot.label, "start"))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _limits(plot: TimePlot) -> tuple[float, float]:
    values = np.concatenate([each.values for each in plot.series])
    known = values[np.isfinite(values)]
    low = min(0.0, float(known.min(initial=0.0)))
    return low - 0.06 * (plot.top - low), plot.top


def _ticks(low: float, high: float) -> list[float]:
    """Multiples of 1, 2 or 5 times a power of ten, 9 at most."""
    power = 10.0 ** math.floor(math.log10((high - low) / 8.0))
    shares = (1.0, 2.0, 5.0, 10.0, 20.0)
    step = next(share * power for share in shares if high - low <= 8.0 * share * power)
    first, last = math.ceil(low / step), math.floor(high / step)
    return [round(count * step, 9) for count in range(first, last + 1)]


def distance_svg(
    distances_mm: FloatArray, held_s: FloatArray, stop_mm: float, warn_mm: float
) -> str:
    """Histogram of the distance; ``distances_mm`` (n,) hold for ``held_s`` (n,); NaN are left out.

    Each bar has a width of 1 mm, and its text as a title. ``stop_mm`` and ``warn_mm`` are marked.
    """
    area = _HISTOGRAM
    known = np.isfinite(distances_mm)
    low = math.floor(min(float(distances_mm[known].min(initial=0.0)), 0.0))
    edges = np.arange(low, MAX_MM + 1.0)
    seconds, _ = np.histogram(distances_mm[known], edges, weights=held_s[known])
    farther_s = float(held_s[known & (distances_mm > MAX_MM)].sum())
    top = _nice(float(seconds.max(initial=0.0)))
    width = (area.right - area.left) / len(seconds)
    scale = (area.bottom - area.top) / top
    base = area.bottom

    def x(distance: float) -> float:
        return area.left + (distance - low) * width

    parts = [
        svg_head(
            area.width,
            area.height,
            "Time at each distance from the tumour",
            f"{farther_s:.1f} s farther than {MAX_MM:g} mm are not shown",
        )
    ]
    for tick in np.linspace(0.0, top, 5).tolist():
        y = base - tick * scale
        parts.append(_line(area.left, y, area.right, y, LINE))
        parts.append(_text(area.left - 6.0, y + 4.0, f"{tick:g} s", "end"))
    for start, value in zip(edges[:-1].tolist(), seconds.tolist(), strict=True):
        if value > 0.0:
            height = max(value * scale, 0.6)
            color = _color(start, stop_mm, warn_mm)
            parts.append(
                f'<rect x="{x(start) + 0.5:.2f}" y="{base - height:.2f}" width="{width - 1.0:.2f}" '
                f'height="{height:.2f}" fill="{color}"><title>{start:g} to {start + 1.0:g} mm: '
                f"{value:.2f} s</title></rect>"
            )
    ticks = range(5 * math.ceil(low / 5), int(MAX_MM) + 1, 5)
    parts.extend(_text(x(tick), base + 18.0, f"{tick}", "middle") for tick in ticks)
    for value, name in ((0.0, "surface"), (stop_mm, "stop"), (warn_mm, "warning")):
        if low <= value <= MAX_MM:
            parts.append(_line(x(value), area.top, x(value), base, INK, dash="4 3", title=name))
    parts.append(_line(area.left, base, area.right, base, INK))
    parts.append(area.axis_label("distance, mm"))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _color(start: float, stop_mm: float, warn_mm: float) -> str:
    middle = start + 0.5
    if middle < 0.0:
        return INSIDE_BAR
    if middle < stop_mm:
        return STOP_BAR
    return WARN_BAR if middle < warn_mm else CLEAR_BAR


def _nice(value: float) -> float:
    """The next of 1, 2, 4, 8 times a power of ten, for four equal steps."""
    if value <= 0.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(step for step in (1.0, 2.0, 4.0, 8.0, 10.0) if step * power >= value)


def svg_head(width: float, height: float, title: str, description: str = "") -> str:
    """The begin of a figure: its size, font, title and description."""
    described = f"<desc>{escape(description)}</desc>" if description else ""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">\n'
        f"<title>{escape(title)}</title>{described}"
    )


def _line(
    x1: float, y1: float, x2: float, y2: float, color: str, *, dash: str = "", title: str = ""
) -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    inner = f"<title>{escape(title)}</title>" if title else ""
    return (
        f'<line x1="{x1:.2f}" y1="{y1:.2f}" x2="{x2:.2f}" y2="{y2:.2f}" stroke="{color}"{dashed}>'
        f"{inner}</line>"
    )


def _text(x: float, y: float, text: str, anchor: str, color: str = INK) -> str:
    return (
        f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" fill="{color}">{escape(text)}</text>'
    )
