"""Histogram of the distance as SVG: how long the tool was at each distance from the tumour."""

import math
from html import escape

import numpy as np

from app.geometry import FloatArray
from app.report.colors import CLEAR_BAR, INK, INSIDE_BAR, LINE, STOP_BAR, WARN_BAR

MAX_MM = 30.0
"""Larger distances are left out; the caption says how long they lasted."""
_WIDTH, _HEIGHT = 640.0, 260.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 12.0, 14.0, 46.0


def distance_svg(
    distances_mm: FloatArray, held_s: FloatArray, stop_mm: float, warn_mm: float
) -> str:
    """The figure; ``distances_mm`` (n,) hold for ``held_s`` (n,); NaN are left out.

    Each bar has a width of 1 mm, and its text as a title. ``stop_mm`` and ``warn_mm`` are marked.
    """
    known = np.isfinite(distances_mm)
    low = math.floor(min(float(distances_mm[known].min(initial=0.0)), 0.0))
    edges = np.arange(low, MAX_MM + 1.0)
    seconds, _ = np.histogram(distances_mm[known], edges, weights=held_s[known])
    farther_s = float(held_s[known & (distances_mm > MAX_MM)].sum())
    top = _nice(float(seconds.max(initial=0.0)))
    width = (_WIDTH - _LEFT - _RIGHT) / len(seconds)
    scale = (_HEIGHT - _TOP - _BOTTOM) / top
    base = _HEIGHT - _BOTTOM

    def x(distance: float) -> float:
        return _LEFT + (distance - low) * width

    parts = [_head(f"{farther_s:.1f} s farther than {MAX_MM:g} mm are not shown")]
    for tick in np.linspace(0.0, top, 5).tolist():
        y = base - tick * scale
        parts.append(_line(_LEFT, y, _WIDTH - _RIGHT, y, LINE))
        parts.append(_text(_LEFT - 6.0, y + 4.0, f"{tick:g} s", "end"))
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
            parts.append(_line(x(value), _TOP, x(value), base, INK, dash="4 3", title=name))
    parts.append(_line(_LEFT, base, _WIDTH - _RIGHT, base, INK))
    parts.append(_text((_LEFT + _WIDTH - _RIGHT) / 2.0, _HEIGHT - 8.0, "distance, mm", "middle"))
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


def _head(description: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">\n'
        f"<title>Time at each distance from the tumour</title><desc>{escape(description)}</desc>"
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


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}">{escape(text)}</text>'
