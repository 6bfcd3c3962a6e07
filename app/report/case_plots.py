"""The plots over time of a case: its distance with states and margins, its probability."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from app.analysis.breaches import Breach
from app.fixture import MarginParameters, MarginState
from app.geometry import FloatArray
from app.report.colors import INK, LOWER_BOUND, STOP, WARN
from app.report.rows import ReportRow, played_seconds, state_bands
from app.report.time_plot import Band, Line, Mark, Series, TimePlot

if TYPE_CHECKING:
    from app.analysis import CaseAnalysis

_SHOWN_TIMESWARN = 5.0
_DISTANCE = "signed distance, tool to tumour [mm]"


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
        top=_SHOWN_TIMESWARN * margins.warn_mm,
        bands=tuple(
            Band(
                start_s,
                end_s,
                f"{state.display.symbol} {state.name}",
                state.display.color_hex,
                state.display.text_color_hex,
            )
            for state, start_s, end_s in state_bands(rows, seconds)
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
        top=_SHOWN_TIMESWARN * margins.warn_mm,
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
