"""``approach.html``: the robot along its way, which the reader turns, and its distances."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from app.geometry import FloatArray
from app.planning import ApproachPreview
from app.report.coverage_figures import packed, simplified
from app.report.margin_plot import figure_png
from app.report.page import CLEAR_BAR, HATCH, INK, PAPER, STOP, USED, WARN, document, json_of, part
from app.report.svg_plots import time_svg
from app.report.time_plot import Line, Series, TimePlot

_MAX_FACES = 400
"""Faces of a link in the figure."""
_STEPS_OF_REACH = 0x7FFF
_AZIMUTH_DEG, _ELEVATION_DEG = -35.0, 25.0
_AMBIENT, _DIRECT = 0.55, 0.45
_DPI = 100
_COLORS = {"moving": CLEAR_BAR, "structure": STOP}
_CURVES = (USED, WARN, HATCH, STOP)
_GHOST = 0.2
"""Opacity of the robot at its goal."""

_Surface = tuple[FloatArray, NDArray[np.integer]]


def approach_page(preview: ApproachPreview, robot: str) -> str:
    """The page; every value is escaped. ``robot`` is the name."""
    approach, distances = preview.approach, preview.distances_mm
    clearance = f"{approach.clearance_mm:g} mm"
    is_known = bool(np.isfinite(distances).any())
    return document(
        "approach.html",
        f"{robot}: approach",
        figures=True,
        tiles=[
            (f"{preview.times_s[-1]:.2f} s", "duration"),
            (
                f"{np.nanmin(distances):.1f} mm" if is_known else "-",
                "least distance at the times shown",
            ),
            (clearance, "clearance that is proven for the whole way"),
            (str(preview.via_states), "stops on the way"),
        ],
        motion=_motion_figure(preview),
        distances=_distance_plot(preview) if is_known else None,
        nearest=[
            (name, f"{column.min():.2f} mm", f"{preview.times_s[column.argmin()]:.2f} s")
            for (name, _), column in zip(preview.structures, distances.T, strict=True)
            if np.isfinite(column).all()
        ],
        reasons=approach.reasons,
        joints=[
            (name, f"{first:.4f}", f"{last:.4f}", f"{fastest:.3f}")
            for name, first, last, fastest in zip(
                approach.joints,
                *approach.positions[[0, -1]].tolist(),
                np.abs(approach.velocities).max(axis=0).tolist(),
                strict=True,
            )
        ],
        held=[(name, f"{value:.4f}") for name, value in approach.held.items()],
        made_from=list(approach.made_from.items()),
    )


def _distance_plot(preview: ApproachPreview) -> Markup:
    distances, clearance_mm = preview.distances_mm, preview.approach.clearance_mm
    series = [
        Series(name, _CURVES[number % len(_CURVES)], column)
        for number, ((name, _), column) in enumerate(
            zip(preview.structures, distances.T, strict=True)
        )
    ]
    known = distances[np.isfinite(distances)]
    plot = TimePlot(
        preview.times_s,
        tuple(series),
        "distance from the robot [mm]",
        top=1.05 * float(known.max(initial=clearance_mm)),
        lines=(Line(clearance_mm, f"clearance {clearance_mm:g}", STOP),),
        x_label="time from the start [s]",
    )
    title = "Distance of each structure from the robot over time"
    return plot.html(Markup(time_svg(plot, title)), title)


def _motion_figure(preview: ApproachPreview) -> Markup:
    surfaces = [simplified(mesh, _MAX_FACES) for _, mesh in preview.moving]
    surfaces += [simplified(mesh) for _, mesh in preview.structures]
    return part(
        "motion.html",
        still_png=_stills_png(preview, surfaces),
        data=json_of(_motion_document(preview, surfaces)),
        last=len(preview.samples) - 1,
        legend=[("robot", CLEAR_BAR, 1.0), ("robot at the goal", CLEAR_BAR, _GHOST)]
        + ([("structure", STOP, 1.0)] if preview.structures else []),
        ink=INK,
    )


def _motion_document(preview: ApproachPreview, surfaces: list[_Surface]) -> dict[str, Any]:
    """The scene as JSON types, as `web/motion.js` reads it.

    ``vertices`` are int16 and ``faces`` uint16 as in the coverage, in the body's frame. A pose has
    the rows of a 3 x 4 matrix in mm.
    """
    center, reach_mm = _extent(preview, surfaces)
    rows = preview.poses[:, :, :3]
    bodies: list[dict[str, Any]] = []
    for vertices, faces in surfaces:
        vertex_mm = max(float(np.abs(vertices).max()), 1e-3) / _STEPS_OF_REACH
        bodies.append(
            {
                "vertices": packed(np.round(vertices / vertex_mm), "<i2"),
                "vertex_mm": vertex_mm,
                "faces": packed(faces, "<u2"),
                "color": _COLORS["moving" if len(bodies) < len(preview.moving) else "structure"],
            }
        )
    return {
        "bodies": bodies,
        "times_s": np.round(preview.times_s, 3).tolist(),
        "poses": np.round(rows.reshape(*rows.shape[:2], 12), 5).tolist(),
        "structures": [name for name, _ in preview.structures],
        "distances_mm": [
            [None if math.isnan(each) else round(each, 2) for each in row]
            for row in preview.distances_mm.tolist()
        ],
        "center": np.round(center, 3).tolist(),
        "reach": reach_mm,
        "ghost": _GHOST,
        "ambient": _AMBIENT,
        "direct": _DIRECT,
        "paper": PAPER,
        "start": {"azimuth": _AZIMUTH_DEG, "elevation": _ELEVATION_DEG},
    }


def _extent(preview: ApproachPreview, surfaces: list[_Surface]) -> tuple[FloatArray, float]:
    """Centre (3,) of all that is seen at any time, and the distance of the farthest point."""
    points = np.concatenate(
        [
            corners.reshape(-1, 3)
            for number in range(len(preview.samples))
            for corners, _ in _placed(preview, surfaces, number)
        ]
    )
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return center, float(np.linalg.norm(points - center, axis=1).max())


def _placed(
    preview: ApproachPreview, surfaces: list[_Surface], number: int
) -> Iterator[tuple[FloatArray, str]]:
    """The corners (m, 3, 3) of each body at the time ``number``, and its colour."""
    for body, (vertices, faces) in enumerate(surfaces):
        if body < len(preview.moving):
            pose = preview.poses[number, body]
            yield (vertices @ pose[:3, :3].T + pose[:3, 3])[faces], _COLORS["moving"]
        else:
            yield vertices[faces], _COLORS["structure"]


def _stills_png(preview: ApproachPreview, surfaces: list[_Surface]) -> bytes:
    """The robot at the start, where it is nearest to a structure, and at the end."""
    last = len(preview.samples) - 1
    nearest = last // 2
    if preview.distances_mm.size:
        nearest = int(preview.distances_mm.min(axis=1).argmin())
    azimuth, elevation = np.radians([_AZIMUTH_DEG, _ELEVATION_DEG])
    right = np.array([-np.cos(azimuth), np.sin(azimuth), 0.0])
    towards = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.cos(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    up = np.cross(towards, right)
    center, reach_mm = _extent(preview, surfaces)
    figure = Figure(figsize=(11.0, 3.9), dpi=_DPI, layout="constrained")
    for axes, number in zip(figure.subplots(1, 3), (0, nearest, last), strict=True):
        corners, colors = [], []
        for placed, color in _placed(preview, surfaces, number):
            normals = np.cross(placed[:, 1] - placed[:, 0], placed[:, 2] - placed[:, 0])
            lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
            light = _AMBIENT + _DIRECT * np.abs(normals @ towards) / lengths
            corners.append(placed - center)
            colors.append(light[:, None] * to_rgb(color))
        seen, shades = np.concatenate(corners), np.concatenate(colors)
        order = (seen @ towards).mean(axis=1).argsort()
        flat = np.stack([seen @ right, seen @ up], axis=2)[order]
        axes.add_collection(PolyCollection(list(flat), facecolors=shades[order], lw=0.0))
        axes.set_title(f"{preview.times_s[number]:.2f} s", fontsize=10, color=INK)
        axes.set_xlim(-reach_mm, reach_mm)
        axes.set_ylim(-reach_mm, reach_mm)
        axes.set_aspect("equal")
        axes.axis("off")
    return figure_png(figure)
