"""Figures of the tumour's coverage: six views as SVG, and a surface that the reader turns.

`web/coverage.js` draws the surface. A browser without scripts and a printer show the views instead.
"""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from app.analysis.coverage import WITHIN_MM, Coverage, spread_faces
from app.geometry import ANATOMICAL_AXES, ANATOMICAL_WORDS, FloatArray, SurfaceMesh
from app.report.page import (
    AMBIENT,
    CLASS_NAMES,
    COLORS,
    DIRECT,
    INK,
    PAPER,
    json_of,
    part,
    shaded,
)
from app.report.svg_plots import svg_head

MAX_FACES = 1600
_MAX_SAMPLE = 20_000
_ROUNDS = 4
_CELL, _GAP, _LABEL, _LEGEND = 190.0, 12.0, 22.0, 44.0
_VIEWS = (("R", "S"), ("A", "S"), ("S", "A"), ("L", "S"), ("P", "S"), ("I", "A"))
"""Side that is seen, and direction that is up in the picture."""
STEPS_PER_MM = 1000
"""Distances in the page are whole numbers of these steps, rounded up: no class changes by it."""
FARTHER = 0xFFFF
"""Stands for a distance beyond the largest of `WITHIN_MM`."""
MAX_VERTICES = 0x10000
_STEPS_OF_REACH = 0x7FFF


@dataclass(frozen=True, slots=True, eq=False)
class CoveredSurface:
    """A surface about the tumour's centroid, in the patient's axes (right, anterior, superior).

    ``vertices_mm`` (n, 3) and ``faces`` (m, 3), wound outwards. ``nearest_mm`` (m,): the least
    distance of the tool, infinite beyond the largest of `WITHIN_MM`. ``breaches_mm`` (b, 3): the
    places of the breaches, in the order of time.
    """

    vertices_mm: FloatArray
    faces: NDArray[np.integer]
    nearest_mm: FloatArray
    breaches_mm: FloatArray

    @property
    def corners_mm(self) -> FloatArray:
        """The corners (m, 3, 3) of the faces."""
        return np.asarray(self.vertices_mm[self.faces])

    @property
    def normals(self) -> FloatArray:
        """The outward unit normals (m, 3) of the faces."""
        corners = self.corners_mm
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None])

    @property
    def classes(self) -> NDArray[np.intp]:
        """The first of `WITHIN_MM` that each face (m,) is within; their number beyond the last."""
        return np.searchsorted(WITHIN_MM, self.nearest_mm, side="left")

    @property
    def reach_mm(self) -> float:
        """Distance of the farthest vertex from the centroid."""
        return float(np.linalg.norm(self.vertices_mm, axis=1).max())


def covered_surface(
    tumor: SurfaceMesh,
    coverage: Coverage,
    breaches_mm: Sequence[tuple[float, float, float]] = (),
    ras_from_tumor: FloatArray | None = None,
) -> CoveredSurface:
    """``tumor`` with at most about `MAX_FACES` faces, each with the value of the nearest place of
    ``coverage``.

    ``breaches_mm`` are places in the tumour's frame. Without ``ras_from_tumor`` (3, 3) the tumour's
    axes are taken as right, anterior and superior.
    """
    vertices, faces = simplified(tumor)
    nearest = _nearest(coverage.places_mm, vertices[faces].mean(axis=1))
    turn = np.eye(3) if ras_from_tumor is None else ras_from_tumor
    centroid = tumor.centroid_mm
    places = np.array(breaches_mm, dtype=np.float64).reshape(-1, 3)
    return CoveredSurface(
        (vertices - centroid) @ turn.T,
        faces,
        coverage.nearest_mm[nearest],
        (places - centroid) @ turn.T,
    )


def simplified(
    surface: SurfaceMesh, max_faces: int = MAX_FACES
) -> tuple[FloatArray, NDArray[np.integer]]:
    """Vertices (n, 3) and faces (m, 3) of a mesh like ``surface`` with about ``max_faces`` at most.

    The vertices are grouped around means that are spread over the surface, and each group becomes
    its mean: the faces have similar sizes. A closed surface stays closed.
    """
    vertices = surface.vertices_mm
    if len(surface.faces) <= max_faces:
        return vertices, surface.faces
    groups = max_faces // 2  # a closed surface has about twice as many faces as vertices
    means = vertices[spread_faces(vertices, groups)]
    sample = vertices[spread_faces(vertices, _MAX_SAMPLE)]
    for _ in range(_ROUNDS):
        means = _means(sample, _nearest(means, sample), means)
    group = _nearest(means, vertices)
    return _means(vertices, group, means), _without_collapsed(group[surface.faces])


def _nearest(points: FloatArray, places: FloatArray) -> NDArray[np.intp]:
    """Index of the nearest of ``points`` (n, 3) to each of ``places`` (m, 3)."""
    from scipy.spatial import cKDTree  # slow to load

    return np.asarray(cKDTree(points).query(places)[1], dtype=np.intp)


def _means(points: FloatArray, group: NDArray[np.intp], means: FloatArray) -> FloatArray:
    """The mean (g, 3) of each group of ``points`` (n, 3); of an empty one that of ``means``."""
    count = np.bincount(group, minlength=len(means))
    sums = np.stack([np.bincount(group, points[:, k], len(means)) for k in range(3)], axis=1)
    return np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], means)


def _without_collapsed(faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """``faces`` (m, 3) with three different vertices, each once; opposite ones cancel."""
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)
    turned = turned[(turned[:, 1] != turned[:, 2]) & (turned[:, 0] < turned[:, 1:].min(axis=1))]
    flipped = turned[:, 1] > turned[:, 2]
    pairs = np.where(flipped[:, None], turned[:, [0, 2, 1]], turned)
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    net = np.bincount(index.reshape(-1), np.where(flipped, -1.0, 1.0), len(unique))
    return np.concatenate([unique[net > 0.0], unique[net < 0.0][:, [0, 2, 1]]])


def coverage_svg(surface: CoveredSurface) -> str:
    """Six orthographic views, from the right, anterior, superior, left, posterior and inferior.

    The number of a breach is at its place in the views of that side.
    """
    width, height = 3.0 * _CELL + 2.0 * _GAP, 2.0 * (_CELL + _LABEL) + _GAP + _LEGEND
    parts = [
        svg_head(width, height, "Least distance of the tool to each part of the tumour's surface")
    ]
    for index, (side, up) in enumerate(_VIEWS):
        row, column = divmod(index, 3)
        left, top = column * (_CELL + _GAP), row * (_CELL + _LABEL + _GAP)
        parts.append(f'<g transform="translate({left:g} {top:g})" stroke-width=".4">')
        parts.append(f'<text x="2" y="15">from {ANATOMICAL_WORDS[side]}</text>')
        parts.extend(_view(surface, ANATOMICAL_AXES[side], ANATOMICAL_AXES[up]))
        parts.append("</g>")
    parts.extend(_legend(height - 16.0))
    return "\n".join([*parts, "</svg>"]) + "\n"


def _view(surface: CoveredSurface, towards: FloatArray, up: FloatArray) -> list[str]:
    """Polygons seen from ``towards`` (3,), the farthest first, and the breaches of that side."""
    right = np.cross(up, towards)
    corners, normals = surface.corners_mm, surface.normals
    facing = np.flatnonzero(normals @ towards > 0.0)
    depth = (corners[facing] @ towards).mean(axis=1)
    facing = facing[np.argsort(depth, kind="stable")]
    scale = 0.5 * (_CELL - 6.0) / surface.reach_mm
    x = 0.5 * _CELL + scale * (corners[facing] @ right)
    y = _LABEL + 0.5 * _CELL - scale * (corners[facing] @ up)
    light = AMBIENT + DIRECT * (normals[facing] @ towards)
    parts = [
        f'<path d="M{a[0]:.1f} {b[0]:.1f}L{a[1]:.1f} {b[1]:.1f}L{a[2]:.1f} {b[2]:.1f}Z" '
        f'fill="{color}" stroke="{color}"/>'
        for a, b, color in zip(
            x.tolist(),
            y.tolist(),
            map(shaded, surface.classes[facing].tolist(), light.tolist()),
            strict=True,
        )
    ]
    for number, place in enumerate(surface.breaches_mm, start=1):
        if place @ towards > 0.5 * np.linalg.norm(place):
            at_x = 0.5 * _CELL + scale * float(place @ right)
            at_y = _LABEL + 0.5 * _CELL - scale * float(place @ up)
            parts.append(
                f'<circle cx="{at_x:.1f}" cy="{at_y:.1f}" r="7" fill="{PAPER}" stroke="{INK}" '
                'stroke-width="1.2"/>'
                f'<text x="{at_x:.1f}" y="{at_y + 3.5:.1f}" text-anchor="middle" font-size="10" '
                f'font-weight="bold">{number}</text>'
            )
    return parts


def _legend(y: float) -> list[str]:
    parts = []
    for index, (color, name) in enumerate(zip(COLORS, CLASS_NAMES, strict=True)):
        x = 2.0 + index * 118.0
        parts.append(
            f'<rect x="{x:g}" y="{y - 11.0:g}" width="14" height="14" fill="{color}" '
            f'stroke="{INK}" stroke-width=".5"/>'
        )
        parts.append(f'<text x="{x + 19.0:g}" y="{y:g}">{escape(name)}</text>')
    return parts


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
        "vertices": packed(np.round(surface.vertices_mm / vertex_mm), "<i2"),
        "vertex_mm": vertex_mm,
        "faces": packed(surface.faces, "<u2"),
        "nearest": packed(nearest, "<u2"),
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


def packed(values: NDArray[Any], kind: str) -> str:
    """``values`` row by row as base64, in the type that NumPy names ``kind``."""
    return b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode("ascii")
