"""A plot over time as SVG, without a script: the static picture of a `TimePlot`."""

import math
from html import escape

import numpy as np

from app.report.colors import INK, LINE
from app.report.label_layout import spread
from app.report.time_plot import TimePlot, extremes

MAX_POINTS = 2000
_WIDTH, _HEIGHT = 900.0, 300.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 60.0, 12.0, 20.0, 46.0
_LABEL_STEP = 15.0


def time_svg(plot: TimePlot, title: str) -> str:
    """The curves and lines of ``plot``, without its bands."""
    times = plot.times_s
    first, last = float(times[0]), max(float(times[-1]), float(times[0]) + 1e-3)
    low, high = plot.limits or _limits(plot)

    def x(time_s: float) -> float:
        return _LEFT + (time_s - first) / (last - first) * (_WIDTH - _LEFT - _RIGHT)

    def y(value: float) -> float:
        share = (min(max(value, low), high) - low) / (high - low)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">\n'
        f"<title>{escape(title)}</title>"
    ]
    for value in _ticks(low, high):
        parts.append(_line(y(value), LINE))
        parts.append(_text(_LEFT - 6.0, y(value) + 4.0, f"{value:g}", "end"))
    parts.extend(
        _text(x(time_s), _HEIGHT - _BOTTOM + 18.0, f"{time_s:g}", "middle")
        for time_s in _ticks(first, last)
    )
    lines = [line for line in plot.lines if low <= line.value <= high]
    parts.extend(_line(y(line.value), line.color, dash=' stroke-dasharray="6 4"') for line in lines)
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
    heights = spread([y(line.value) - 3.0 for line in lines], _LABEL_STEP, _TOP + 10.0)
    parts.append('<g stroke="#fff" stroke-width="3" paint-order="stroke">')  # curves may cross them
    for line, at in zip(lines, heights, strict=True):
        parts.append(_text(_WIDTH - _RIGHT - 4.0, at, line.label, "end", line.color))
    parts.append("</g>")
    middle = (_LEFT + _WIDTH - _RIGHT) / 2.0
    parts.append(_text(middle, _HEIGHT - 8.0, "time from the first frame, s", "middle"))
    parts.append(_text(_LEFT, _TOP - 4.0, plot.label, "start"))
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


def _line(y: float, color: str, *, dash: str = "") -> str:
    return (
        f'<line x1="{_LEFT:g}" y1="{y:.1f}" x2="{_WIDTH - _RIGHT:g}" y2="{y:.1f}" '
        f'stroke="{color}"{dash}/>'
    )


def _text(x: float, y: float, text: str, anchor: str, color: str = INK) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{color}">{escape(text)}</text>'
    )
