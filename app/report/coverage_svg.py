"""Coverage map of the tumour as SVG: its surface from six sides, coloured by the least distance."""

from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from app.analysis.coverage import WITHIN_MM, Coverage
from app.analysis.swept_volume import solid_of, surface_of
from app.geometry import ANATOMICAL_AXES, ANATOMICAL_WORDS, FloatArray, MeshError, SurfaceMesh

COLORS = ("#7a0c02", "#d5560f", "#f2b63c", "#9ac9a3", "#dfe5ea")
"""Least distance up to each of `WITHIN_MM`, and beyond the last."""
MAX_FACES = 1600
_TOLERANCES_MM = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
_CELL, _GAP, _LABEL, _LEGEND = 190.0, 12.0, 22.0, 44.0
_VIEWS = (("R", "S"), ("A", "S"), ("S", "A"), ("L", "S"), ("P", "S"), ("I", "A"))
"""Side that is seen, and direction that is up in the picture."""


def coverage_svg(
    tumor: SurfaceMesh, coverage: Coverage, ras_from_tumor: FloatArray | None = None
) -> str:
    """Six orthographic views, from the right, anterior, superior, left, posterior and inferior.

    The surface is drawn with at most about `MAX_FACES` faces; each has the least distance of the
    nearest face of ``coverage``.
    """
    from scipy.spatial import cKDTree  # slow to load

    drawn = _simplified(tumor)
    centres = tumor.triangles_mm[coverage.faces].mean(axis=1)
    _, nearest = cKDTree(centres).query(drawn.triangles_mm.mean(axis=1))
    classes = np.searchsorted(WITHIN_MM, coverage.nearest_mm[nearest], side="left")
    turn = np.eye(3) if ras_from_tumor is None else ras_from_tumor
    corners = (drawn.triangles_mm - drawn.centroid_mm) @ turn.T
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    picture = _Picture(corners, normals / lengths[:, None], classes)
    width, height = 3.0 * _CELL + 2.0 * _GAP, 2.0 * (_CELL + _LABEL) + _GAP + _LEGEND
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
        'font-family="system-ui, sans-serif" font-size="13" fill="#1c2733">\n'
        "<title>Least distance of the tool to each part of the tumour's surface</title>"
    ]
    for index, (side, up) in enumerate(_VIEWS):
        row, column = divmod(index, 3)
        left, top = column * (_CELL + _GAP), row * (_CELL + _LABEL + _GAP)
        parts.append(f'<g transform="translate({left:g} {top:g})">')
        parts.append(f'<text x="2" y="15">from {ANATOMICAL_WORDS[side]}</text>')
        parts.extend(picture.view(ANATOMICAL_AXES[side], ANATOMICAL_AXES[up]))
        parts.append("</g>")
    parts.extend(_legend(height - 16.0))
    return "\n".join([*parts, "</svg>"]) + "\n"


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    """Corners (m, 3, 3) about the centre, outward normals (m, 3), colour classes (m,)."""

    corners: FloatArray
    normals: FloatArray
    classes: NDArray[np.intp]

    def view(self, towards: FloatArray, up: FloatArray) -> list[str]:
        """Polygons seen from ``towards`` (3,), the farthest first."""
        right = np.cross(up, towards)
        facing = np.flatnonzero(self.normals @ towards > 0.0)
        depth = (self.corners[facing] @ towards).mean(axis=1)
        facing = facing[np.argsort(depth, kind="stable")]
        reach = float(np.linalg.norm(self.corners, axis=2).max())
        scale = 0.5 * (_CELL - 6.0) / reach
        x = 0.5 * _CELL + scale * (self.corners[facing] @ right)
        y = _LABEL + 0.5 * _CELL - scale * (self.corners[facing] @ up)
        light = 0.72 + 0.28 * (self.normals[facing] @ towards)
        return [
            f'<path d="M{a[0]:.1f} {b[0]:.1f}L{a[1]:.1f} {b[1]:.1f}L{a[2]:.1f} {b[2]:.1f}Z" '
            f'fill="{color}" stroke="{color}" stroke-width=".4"/>'
            for a, b, color in zip(
                x.tolist(),
                y.tolist(),
                map(_shaded, self.classes[facing].tolist(), light.tolist()),
                strict=True,
            )
        ]


def _shaded(number: int, light: float) -> str:
    base = COLORS[number]
    level = round(light * 12.0) / 12.0  # few colours: a smaller file
    return "#" + "".join(f"{round(int(base[k : k + 2], 16) * level):02x}" for k in (1, 3, 5))


def _legend(y: float) -> list[str]:
    names = [*(f"within {within:g} mm" for within in WITHIN_MM), "farther"]
    parts = []
    for index, (color, name) in enumerate(zip(COLORS, names, strict=True)):
        x = 2.0 + index * 118.0
        parts.append(f'<rect x="{x:g}" y="{y - 11.0:g}" width="14" height="14" fill="{color}"/>')
        parts.append(f'<text x="{x + 19.0:g}" y="{y:g}">{escape(name)}</text>')
    return parts


def _simplified(tumor: SurfaceMesh) -> SurfaceMesh:
    """``tumor`` with few faces; itself if it is not closed."""
    try:
        solid = solid_of(tumor)
    except MeshError:
        return tumor
    for tolerance_mm in _TOLERANCES_MM:
        if solid.num_tri() <= MAX_FACES:
            break
        solid = solid.simplify(tolerance_mm)
    return tumor if solid.is_empty() else surface_of(solid, tumor.frame)
