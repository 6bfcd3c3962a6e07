"""The tumour's coverage as a surface that the reader turns: data and HTML.

`web/coverage.js` draws it. A browser without scripts and a printer show the six views instead.
"""

from base64 import b64encode
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from app.analysis.coverage import WITHIN_MM
from app.geometry import ANATOMICAL_AXES, ANATOMICAL_WORDS, FloatArray
from app.report.colors import AMBIENT, CLASS_NAMES, COLORS, DIRECT, INK, PAPER
from app.report.covered_surface import CoveredSurface
from app.report.page import json_of, part

STEPS_PER_MM = 1000
"""Distances in the page are whole numbers of these steps, rounded up: no class changes by it."""
FARTHER = 0xFFFF
"""Stands for a distance beyond the largest of `WITHIN_MM`."""
MAX_VERTICES = 0x10000
_STEPS_OF_REACH = 0x7FFF


def coverage_figure(surface: CoveredSurface, views: Markup) -> Markup:
    """The figure; ``views`` is the picture that paper and no script show.

    It is that picture alone for a surface of more than `MAX_VERTICES` vertices, which only one that
    is not closed can have.
    """
    is_turned = len(surface.vertices_mm) <= MAX_VERTICES
    return part(
        "coverage.html",
        title="Coverage of the tumour",
        views=views,
        data=json_of(coverage_document(surface)) if is_turned else None,
        classes=list(zip(COLORS, CLASS_NAMES, strict=True)),
        ink=INK,
        paper=PAPER,
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


def _packed(values: NDArray[Any], kind: str) -> str:
    return b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
