"""The tumour's coverage as a surface that the reader turns: data and HTML.

`web/coverage.js` draws it. A browser without scripts and a printer show the six views instead.
"""

import json
from base64 import b64encode
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.coverage import WITHIN_MM
from app.geometry import ANATOMICAL_AXES, ANATOMICAL_WORDS, FloatArray
from app.report.coverage_colors import AMBIENT, CLASS_NAMES, COLORS, DIRECT, INK, PAPER
from app.report.covered_surface import CoveredSurface
from app.report.page import scrolling

STEPS_PER_MM = 1000
"""Distances in the page are whole numbers of these steps, rounded up: no class changes by it."""
FARTHER = 0xFFFF
"""Stands for a distance beyond the largest of `WITHIN_MM`."""
MAX_VERTICES = 0x10000
_TITLE = "Coverage of the tumour"
_STEPS_OF_REACH = 0x7FFF
_HELP = (
    "Drag or use the arrow keys to turn, + and - or the wheel to zoom, 0 to reset. The distance is "
    "that under the pointer, with keys that at the cross."
)


def coverage_figure(surface: CoveredSurface, views: str) -> str:
    """The figure; ``views`` is the HTML of the picture that paper and no script show.

    It is that picture alone for a surface of more than `MAX_VERTICES` vertices, which only one that
    is not closed can have.
    """
    if len(surface.vertices_mm) > MAX_VERTICES:
        return scrolling(views, _TITLE, "figure")
    data = json.dumps(coverage_document(surface), allow_nan=False, separators=(",", ":"))
    return (
        f'<figure class="coverage" aria-label="{_TITLE}">{scrolling(views, _TITLE, "static")}'
        '<div class="turned"><div class="tools"></div>'
        '<canvas tabindex="0" role="application" aria-label="Surface of the tumour" '
        'aria-describedby="coverage-help"></canvas>'
        f'<p class="reading" role="status"></p>{_legend()}'
        f'<p class="help" id="coverage-help">{escape(_HELP)}</p></div>'
        f'<script type="application/json">{data}</script></figure>'
    )


def coverage_document(surface: CoveredSurface) -> dict[str, Any]:
    """The surface as JSON types, as `web/coverage.js` reads it.

    ``vertices`` are int16, ``faces`` and ``nearest`` uint16, little-endian in base64, row by row.
    A vertex is a multiple of ``vertex_mm``, a distance of ``nearest_mm``, or `FARTHER`.
    """
    vertex_mm = surface.reach_mm / _STEPS_OF_REACH
    steps = np.ceil(
        np.where(np.isfinite(surface.nearest_mm), surface.nearest_mm, 0.0) * STEPS_PER_MM
    )
    nearest = np.where(surface.nearest_mm <= max(WITHIN_MM), steps, FARTHER)
    places = surface.breaches_mm
    return {
        "vertices": _packed(np.round(surface.vertices_mm / vertex_mm), "<i2"),
        "vertex_mm": vertex_mm,
        "faces": _packed(surface.faces, "<u2"),
        "nearest": _packed(nearest, "<u2"),
        "nearest_mm": 1.0 / STEPS_PER_MM,
        "farther": FARTHER,
        "within_mm": WITHIN_MM,
        "colors": COLORS,
        "ambient": AMBIENT,
        "direct": DIRECT,
        "ink": INK,
        "paper": PAPER,
        "start": _view_from(_first_seen(surface)),
        "sides": [
            {"letter": letter, "word": ANATOMICAL_WORDS[letter], "axis": axis.tolist()}
            | _view_from(axis)
            for letter, axis in ANATOMICAL_AXES.items()
        ],
        "breaches": [
            {
                "number": str(number),
                "label": f"breach {number}",
                "place": np.round(place, 3).tolist(),
            }
            | _view_from(place)
            for number, place in enumerate(places, start=1)
            if np.isfinite(place).all()
        ],
    }


def _first_seen(surface: CoveredSurface) -> FloatArray:
    """Direction from the centroid to what the reader sees first: where the tool came nearest."""
    nearest = surface.nearest_mm
    if not np.isfinite(nearest).any():
        return np.array([0.5, 1.0, 0.4])
    return np.asarray(surface.corners_mm[int(nearest.argmin())].mean(axis=0))


def _view_from(direction: FloatArray) -> dict[str, float]:
    """Angles in degrees of the view from ``direction`` (3,).

    ``azimuth`` 0 is from anterior, 90 from the right; ``elevation`` 90 from superior. Superior is
    up; in the views from superior and inferior it is anterior.
    """
    x, y, z = (direction / max(float(np.linalg.norm(direction)), 1e-9)).tolist()
    level = float(np.hypot(x, y))
    elevation = round(float(np.degrees(np.arctan2(z, level))), 1)
    if level < 1e-6:
        return {"azimuth": 180.0 if z > 0.0 else 0.0, "elevation": elevation}
    return {"azimuth": round(float(np.degrees(np.arctan2(x, y))), 1), "elevation": elevation}


def _legend() -> str:
    entries = [
        '<li><svg viewBox="0 0 14 14" aria-hidden="true"><rect x=".5" y=".5" width="13" '
        f'height="13" fill="{color}" stroke="{INK}" stroke-width=".5"/></svg>{escape(name)}</li>'
        for color, name in zip(COLORS, CLASS_NAMES, strict=True)
    ]
    entries.append(
        '<li><svg viewBox="0 0 14 14" aria-hidden="true"><circle cx="7" cy="7" r="6" '
        f'fill="{PAPER}" stroke="{INK}" stroke-width="1.5"/></svg>place of a breach</li>'
    )
    return f'<ul class="legend">{"".join(entries)}</ul>'


def _packed(values: NDArray[Any], kind: str) -> str:
    return b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
