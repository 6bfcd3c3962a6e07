"""Interactive plots over time for the pages of reports: data and HTML; `web/plots.js` draws them.

Each figure has a static picture, which a browser without scripts and a printer show.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.report.page import json_of, part

MAX_POINTS = 20_000
"""A longer recording is shown by the lowest and the highest value of each part of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A curve: ``values`` (n,), NaN where they are not known; ``dash`` in pixels."""

    label: str
    color: str
    values: FloatArray
    width: float = 1.5
    dash: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Band:
    """An interval in s with a color behind the curves, and its name above them."""

    start_s: float
    end_s: float
    label: str
    color: str
    text_color: str


@dataclass(frozen=True, slots=True)
class Mark:
    """An interval in s with a button that shows it."""

    start_s: float
    end_s: float
    label: str


@dataclass(frozen=True, slots=True)
class Line:
    """A horizontal line at ``value``."""

    value: float
    label: str
    color: str


@dataclass(frozen=True, slots=True, eq=False)
class TimePlot:
    """Curves over ``times_s`` (n,), non-decreasing.

    The last of the ``series`` is drawn on top. Values have ``digits`` decimals. ``limits`` of the
    vertical axis; without them it follows the curves up to ``top``.
    """

    times_s: FloatArray
    series: tuple[Series, ...]
    label: str
    unit: str = " mm"
    digits: int = 2
    limits: tuple[float, float] | None = None
    top: float = 1.0
    bands: tuple[Band, ...] = ()
    lines: tuple[Line, ...] = ()
    marks: tuple[Mark, ...] = ()

    def document(self) -> dict[str, Any]:
        """The plot as JSON types, as `web/plots.js` reads it: times as steps in ms."""
        chosen = extremes(self.series[-1].values, MAX_POINTS)
        times_ms = np.round(1000.0 * self.times_s[chosen]).astype(np.int64)
        scale = 10**self.digits
        return {
            "times_ms": np.diff(times_ms, prepend=0).tolist(),
            "scale": scale,
            "digits": self.digits,
            "unit": self.unit,
            "x_label": "time from the first frame [s]",
            "y_label": self.label,
            "y_limits": self.limits,
            "y_top": self.top,
            "series": [
                {
                    "label": each.label,
                    "color": each.color,
                    "width": each.width,
                    "dash": each.dash,
                    "values": _integers(scale * each.values[chosen]),
                }
                for each in self.series
            ],
            "bands": [
                {
                    "from": _ms(each.start_s),
                    "to": _ms(each.end_s),
                    "label": each.label,
                    "color": each.color,
                    "text_color": each.text_color,
                }
                for each in self.bands
            ],
            "lines": [
                {"value": each.value, "label": each.label, "color": each.color}
                for each in self.lines
            ],
            "marks": [
                {"from": _ms(each.start_s), "to": _ms(each.end_s), "label": each.label}
                for each in self.marks
            ],
        }

    def html(self, static: Markup, description: str) -> Markup:
        """The figure; ``static`` is its picture."""
        data = json_of(self.document())
        return part("plot.html", static=static, description=description, data=data)


def extremes(values: FloatArray, max_points: int) -> NDArray[np.intp]:
    """Increasing indices, about ``max_points`` at most, with the extremes of ``values`` (n,)."""
    count = len(values)
    if count <= max_points:
        return np.arange(count)
    chosen: list[int] = []
    edges = np.linspace(0, count, max_points // 4 + 1).astype(int).tolist()
    for first, last in pairwise(edges):
        part = values[first:last]
        known = np.flatnonzero(np.isfinite(part))
        chosen += [first, last - 1]
        if len(known):
            chosen.append(first + int(known[part[known].argmin()]))
            chosen.append(first + int(known[part[known].argmax()]))
    return np.unique(chosen)


def _integers(values: FloatArray) -> list[int | None]:
    finite = np.isfinite(values)
    rounded = np.where(finite, np.round(values), 0.0).astype(np.int64)
    return [
        value if known else None
        for value, known in zip(rounded.tolist(), finite.tolist(), strict=True)
    ]


def _ms(value_s: float) -> float:
    return round(value_s, 3)
