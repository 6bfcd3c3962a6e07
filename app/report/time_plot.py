"""Curves over time: the one model that pages, SVG, PNG and PDF draw, and those of a case."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.samples import Breach
from app.fixture import MarginParameters, MarginState
from app.geometry import FloatArray
from app.report.page import INK, LOWER_BOUND, STOP, WARN
from app.report.rows import ReportRow, played_seconds, state_bands

if TYPE_CHECKING:
    from markupsafe import Markup

    from app.analysis import CaseAnalysis

TIME_LABEL = "time from the first frame [s]"
MAX_POINTS = 20_000
"""A longer recording is shown by the lowest and the highest value of each part of it."""
_SHOWN_TIMES_WARN = 5.0
"""A plot of distances reaches up to this many warning distances."""
_DISTANCE = "signed distance, tool to tumour [mm]"


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
    """An interval in s with the color of ``state`` behind the curves, and its name above them."""

    start_s: float
    end_s: float
    state: MarginState

    @property
    def label(self) -> str:
        """Symbol and name of the state."""
        return f"{self.state.display.symbol} {self.state.name}"


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
    x_label: str = TIME_LABEL

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
            "x_label": self.x_label,
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
                    "color": each.state.display.color_hex,
                    "text_color": each.state.display.text_color_hex,
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

    def html(self, static: "Markup", description: str) -> "Markup":
        """The figure, which `web/plots.js` draws; a browser without scripts shows ``static``."""
        from app.report.page import json_of, part  # pictures are drawn without the templates

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


def distance_plot(
    rows: Sequence[ReportRow], breaches: Sequence[Breach], margins: MarginParameters
) -> TimePlot:
    """The signed distance of ``rows``, at least one, with states, margins and breaches."""
    seconds = played_seconds(rows)
    known = np.array([row.state is not MarginState.UNKNOWN for row in rows])
    stop, warn = (
        # While the state is UNKNOWN the margin grows with the age of the data: it is not drawn.
        np.where(known, _column(totals), np.nan)
        for totals in ([row.stop_total_mm for row in rows], [row.warn_total_mm for row in rows])
    )
    return TimePlot(
        seconds,
        (
            Series("lower bound", LOWER_BOUND, _column([row.lower_bound_mm for row in rows]), 0.7),
            Series("applied stop", STOP, stop, 0.9, (2, 3)),
            Series("applied warn", WARN, warn, 0.9, (2, 3)),
            Series("signed distance", INK, _column([row.signed_distance_mm for row in rows])),
        ),
        _DISTANCE,
        top=_SHOWN_TIMES_WARN * margins.warn_mm,
        bands=tuple(
            Band(start_s, end_s, state) for state, start_s, end_s in state_bands(rows, seconds)
        ),
        lines=_lines(margins),
        marks=tuple(
            Mark(float(seconds[breach.first]), float(seconds[breach.last]), f"breach {number}")
            for number, breach in enumerate(breaches, start=1)
        ),
    )


def analysed_distance_plot(found: "CaseAnalysis", margins: MarginParameters) -> TimePlot:
    """The signed distance of an analysis, with its breaches."""
    return TimePlot(
        _rising(found),
        (Series("signed distance", INK, found.distances_mm),),
        _DISTANCE,
        top=_SHOWN_TIMES_WARN * margins.warn_mm,
        lines=_lines(margins),
        marks=tuple(
            Mark(breach.start_s, breach.end_s, f"breach {number}")
            for number, breach in enumerate(found.breaches, start=1)
        ),
    )


def probability_plot(found: "CaseAnalysis") -> TimePlot | None:
    """The probability of a breach at each frame; None where no errors were given."""
    if found.probability is None:
        return None
    moments = Series("P(breach)", STOP, found.probability.moments)
    return TimePlot(
        _rising(found), (moments,), "P(breach)", unit="", digits=4, limits=(0.0, 1.02), top=1.02
    )


def _rising(found: "CaseAnalysis") -> FloatArray:
    """The times of the frames; a jump back of the clock counts as 0 s."""
    steps = np.maximum(np.diff(found.times_s, prepend=found.times_s[:1]), 0.0)
    return np.asarray(np.cumsum(steps))


def _lines(margins: MarginParameters) -> tuple[Line, ...]:
    return (
        Line(0.0, "surface", INK),
        Line(margins.stop_mm, f"stop {margins.stop_mm:g}", STOP),
        Line(margins.warn_mm, f"warn {margins.warn_mm:g}", WARN),
    )


def _column(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def spread(places: Sequence[float], step: float, top: float) -> list[float]:
    """``places`` moved up as far as they must be to be ``step`` apart, in their order.

    Places are those of the labels' lower edges and grow downwards. The lowest keeps its place,
    unless the highest would come above ``top``: then all that are too near to it move down.

    >>> spread([50.0, 100.0, 97.0], 10.0, 0.0)
    [50.0, 100.0, 90.0]
    >>> spread([1.0, 2.0], 10.0, 5.0)
    [5.0, 15.0]
    """
    moved = list(places)
    order = sorted(range(len(places)), key=lambda index: places[index])
    limit = float("inf")
    for index in reversed(order):
        moved[index] = min(places[index], limit)
        limit = moved[index] - step
    limit = top
    for index in order:
        moved[index] = max(moved[index], limit)
        limit = moved[index] + step
    return moved
