"""The distance over time as shapes of an SVG of 1000 x 100 units."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from app.fixture import MarginParameters, MarginState
from app.geometry import NS_PER_S, FloatArray

WIDTH, HEIGHT = 1000.0, 100.0
_MAX_COLUMNS = 1500
"""Columns to which a long curve is reduced, each with its lowest and its highest point."""
_MAX_MM = 30.0
"""Upper end of the scale; the curve leaves the picture above it."""
_MAX_LOWER_END_MM = -2.0
"""The scale begins at this distance or below."""


@dataclass(frozen=True, slots=True)
class Point:
    """A step on the plot; ``distance_mm`` is None while the state is UNKNOWN."""

    time_ns: int
    state: MarginState
    distance_mm: float | None


def plot(
    points: Sequence[Point],
    breaches: Sequence[tuple[int, int]],
    begin_ns: int,
    end_ns: int,
    margins: MarginParameters,
) -> dict[str, Any]:
    """Compute the curve, the bands of the states, the marks of the breaches and the scale lines.

    ``points`` has one or more entries in the order of time from ``begin_ns`` to ``end_ns``;
    ``breaches`` holds begin and end of each breach in ns. The distances ``stop_mm`` and ``warn_mm``
    of ``margins`` have lines of their own. With ``top_mm``, ``mm`` and ``seconds``, of the whole
    height and width, a place on the plot becomes a distance and a time.
    """
    span_ns = max(end_ns - begin_ns, 1)
    per_ns = WIDTH / span_ns
    x = np.array([per_ns * (point.time_ns - begin_ns) for point in points])
    mm = np.array([np.nan if p.distance_mm is None else p.distance_mm for p in points], dtype=float)
    known = mm[np.isfinite(mm)]
    low = float(min(known.min(initial=0.0) - 1.0, _MAX_LOWER_END_MM))
    high = float(min(max(known.max(initial=0.0) + 1.0, 10.0), _MAX_MM))
    scale = HEIGHT / (high - low)
    y = (high - mm) * scale
    return {
        "curve": _curve(x, y),
        "bands": _bands(x, [point.state for point in points]),
        "breaches": [
            {"x": round(per_ns * (first - begin_ns), 2), "w": round(per_ns * (last - first), 2)}
            for first, last in breaches
        ],
        "lines": [
            {"y": round((high - value) * scale, 2), "label": f"{value:g}"}
            for value in (0, 5, 10, 20)
            if low < value < high
        ],
        "limits": [
            {"y": round((high - value) * scale, 2), "label": f"{name} {value:g} mm", "name": name}
            for name, value in (("stop", margins.stop_mm), ("warning", margins.warn_mm))
            if low < value < high
        ],
        "top_mm": round(high, 3),
        "mm": round(high - low, 3),
        "seconds": round(span_ns / NS_PER_S, 6),
    }


def _curve(x: FloatArray, y: FloatArray) -> str:
    """SVG path of the curve, with gaps where the distance is unknown."""
    path: list[str] = []
    columns = (
        np.floor(x * (_MAX_COLUMNS / WIDTH)).astype(int) if len(x) > 2 * _MAX_COLUMNS else None
    )
    drawing = False
    for index in range(len(x)) if columns is None else _extremes(columns, y):
        if not np.isfinite(y[index]):
            drawing = False
            continue
        path.append(f"{'L' if drawing else 'M'}{x[index]:.2f} {y[index]:.2f}")
        drawing = True
    return "".join(path)


def _extremes(columns: FloatArray, y: FloatArray) -> list[int]:
    """Indices of the lowest, the highest and one unknown point of each column, ascending."""
    kept: set[int] = set()
    begin = 0
    for _, group in groupby(columns.tolist()):
        end = begin + sum(1 for _ in group)
        part = y[begin:end]
        finite = np.isfinite(part)
        if finite.any():
            kept |= {begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))}
        if not finite.all():
            kept.add(begin + int(np.argmin(finite)))
        begin = end
    return sorted(kept)


def _bands(x: FloatArray, states: list[MarginState]) -> list[dict[str, Any]]:
    """One band from each change of the state to the next, with the state's label."""
    bands: list[dict[str, Any]] = []
    for index, state in enumerate(states):
        if bands and bands[-1]["state"] == state.name:
            continue
        if bands:
            bands[-1]["w"] = round(float(x[index]) - bands[-1]["x"], 2)
        label = state.display.label.lower()
        bands.append(
            {"state": state.name, "label": label, "x": round(float(x[index]), 2), "w": 0.0}
        )
    if bands:
        bands[-1]["w"] = round(float(x[-1]) - bands[-1]["x"], 2)
    return bands
