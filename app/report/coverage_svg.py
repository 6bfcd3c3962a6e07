"""Coverage map of the tumour as SVG: its surface from six sides, coloured by the least distance."""

from html import escape

import numpy as np

from app.geometry import ANATOMICAL_AXES, ANATOMICAL_WORDS, FloatArray
from app.report.colors import (
    AMBIENT,
    CLASS_NAMES,
    COLORS,
    DIRECT,
    INK,
    PAPER,
    shaded,
)
from app.report.covered_surface import CoveredSurface

_CELL, _GAP, _LABEL, _LEGEND = 190.0, 12.0, 22.0, 44.0
_VIEWS = (("R", "S"), ("A", "S"), ("S", "A"), ("L", "S"), ("P", "S"), ("I", "A"))
"""Side that is seen, and direction that is up in the picture."""


def coverage_svg(surface: CoveredSurface) -> str:
    """Six orthographic views, from the right, anterior, superior, left, posterior and inferior.

    The number of a breach is at its place in the views of that side.
    """
    width, height = 3.0 * _CELL + 2.0 * _GAP, 2.0 * (_CELL + _LABEL) + _GAP + _LEGEND
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img" '
        f'font-family="system-ui, sans-serif" font-size="13" fill="{INK}">\n'
        "<title>Least distance of the tool to each part of the tumour's surface</title>"
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
