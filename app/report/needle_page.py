"""``needle.html``: the map of entries, the offered corridors in section, their distances."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from app.geometry import FloatArray, SurfaceMesh
from app.planning import Corridor, ForbiddenStructure, NeedlePlan
from app.report.margin_plot import figure_png
from app.report.page import CLEAR_BAR, HATCH, INK, LINE, STOP, document, text_of

_DPI = 110
_MAX_DOTS = 20_000
"""Entries in the picture; more would hide each other."""

_BELOW_MM = 25.0
"""Depth of a section below the deepest target."""


def needle_page(
    plan: NeedlePlan,
    target: SurfaceMesh,
    structures: Sequence[ForbiddenStructure],
    inputs: Mapping[str, Any],
) -> str:
    """The page; every value is escaped. ``inputs`` are shown but for its lists and the entries."""
    best = plan.best
    return document(
        "needle.html",
        f"{inputs['case']}: needle to {inputs['target']}",
        tiles=[
            (f"{best.score:.2f}", "score of the best corridor"),
            (f"{best.depth_mm:.1f} mm", "its depth"),
            (f"{math.degrees(best.angle_rad):.0f} deg", "its angle to the skin's normal"),
            (f"{100.0 * np.isfinite(plan.scores).mean():.0f} %", "of the entries allowed"),
        ],
        map_png=_map_png(plan),
        section_png=_section_png(plan.corridors, target, structures),
        rating_header=("corridor", "score", *best.ratings, "depth", "angle"),
        ratings=[
            (
                *(number, *(f"{value:.2f}" for value in (each.score, *each.ratings.values()))),
                *(f"{each.depth_mm:.1f} mm", f"{math.degrees(each.angle_rad):.1f} deg"),
            )
            for number, each in enumerate(plan.corridors, start=1)
        ],
        distances=[
            (
                *(number, found.name, f"{found.clearance_mm:.2f} mm"),
                *(f"{found.required_mm:.2f} mm", f"{found.hit_probability:.3f}"),
            )
            for number, each in enumerate(plan.corridors, start=1)
            for found in each.structures
        ],
        blocked=list(plan.blocked_by().items()),
        inputs=[
            (name, ", ".join(f"{k} {text_of(v)}" for k, v in value.items()))
            if isinstance(value, Mapping)
            else (name, value)
            for name, value in inputs.items()
            if name != "entries" and not isinstance(value, list)
        ],
    )


def _map_png(plan: NeedlePlan) -> bytes:
    """The entries in the plane of their two widest directions."""
    figure = Figure(figsize=(9.0, 6.0), dpi=_DPI, layout="constrained")
    axes = figure.subplots()
    points = plan.region.points_mm
    center = points.mean(axis=0)
    plane = np.linalg.eigh(np.cov((points - center).T))[1][:, :0:-1]
    flat = (points - center) @ plane
    shown = np.arange(0, len(flat), max(1, len(flat) // _MAX_DOTS))
    scores, blocked = plan.scores[shown], plan.blocked[shown]
    for number, name in enumerate(plan.obstacles):
        of_it = shown[np.isnan(scores) & (blocked == number)]
        if len(of_it):
            shade = 0.45 + 0.5 * number / len(plan.obstacles)
            x, y = flat[of_it].T
            axes.scatter(x, y, s=4, color=str(shade), lw=0, label=f"blocked: {name}")
    allowed = shown[np.isfinite(scores)]
    x, y = flat[allowed].T
    dots = axes.scatter(x, y, s=4, c=plan.scores[allowed], cmap="viridis", lw=0)
    figure.colorbar(dots, label="score")
    for number, each in enumerate(plan.corridors, start=1):
        at_x, at_y = (each.entry_mm - center) @ plane
        axes.plot(at_x, at_y, "o", ms=12, mfc="white", mec=INK)
        axes.text(at_x, at_y, str(number), ha="center", va="center", fontsize=8, color=INK)
    axes.set_aspect("equal")
    axes.set_xlabel("mm along the skin")
    axes.set_ylabel("mm along the skin")
    if np.isnan(scores).any():
        axes.legend(fontsize=8, loc="upper left", markerscale=3)
    return figure_png(figure)


def _section_png(
    corridors: Sequence[Corridor], target: SurfaceMesh, structures: Sequence[ForbiddenStructure]
) -> bytes:
    """A section along each corridor: depth downward, through the centre of what is nearest."""
    figure = Figure(figsize=(3.0 * len(corridors), 5.0), dpi=_DPI, layout="constrained")
    deepest_mm = max(each.depth_mm for each in corridors)
    all_axes = figure.subplots(1, len(corridors), squeeze=False, sharey=True)[0]
    for number, (axes, each) in enumerate(zip(all_axes, corridors, strict=True), start=1):
        down = (each.target_mm - each.entry_mm) / each.depth_mm
        aside = _towards_nearest(each, down, structures)
        for surface, color, style in [
            (target, CLEAR_BAR, "solid"),
            *((structure.surface, STOP, "dashed") for structure in structures),
        ]:
            lines = _section(surface, each.entry_mm, aside, down)
            axes.add_collection(LineCollection(list(lines), colors=color, ls=style, lw=1.2))
        axes.plot([0.0, 0.0], [0.0, each.depth_mm], color=INK, lw=1.8)
        axes.axhline(0.0, color=LINE, lw=0.8)
        axes.set_title(f"corridor {number}", fontsize=10, color=INK)
        axes.set_xlim(-0.5 * deepest_mm, 0.5 * deepest_mm)
        axes.set_ylim(deepest_mm + _BELOW_MM, -5.0)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=8, colors=HATCH)
        axes.set_xlabel("mm", fontsize=8)
    all_axes[0].set_ylabel("depth [mm]", fontsize=8)
    kinds = [
        ("target", CLEAR_BAR, "solid"),
        ("forbidden", STOP, "dashed"),
        ("needle", INK, "solid"),
    ]
    handles = [Line2D([], [], color=color, ls=style, label=kind) for kind, color, style in kinds]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure_png(figure)


def _towards_nearest(
    corridor: Corridor, down: FloatArray, structures: Sequence[ForbiddenStructure]
) -> FloatArray:
    """Unit vector across the needle, towards the centroid of the nearest structure."""
    aside = np.linalg.svd(down[None])[2][1]
    if structures:
        near = int(np.argmin([each.clearance_mm for each in corridor.structures]))
        offset = structures[near].surface.centroid_mm - corridor.entry_mm
        across = offset - (offset @ down) * down
        if np.linalg.norm(across) > 1e-6:
            aside = across / np.linalg.norm(across)
    return np.asarray(aside)


def _section(
    surface: SurfaceMesh, origin: FloatArray, aside: FloatArray, down: FloatArray
) -> FloatArray:
    """Where the plane through ``origin`` cuts the triangles: lines (k, 2, 2) along both axes."""
    corners = surface.triangles_mm - origin
    flat = corners @ np.stack([aside, down], axis=1)
    height = corners @ np.cross(aside, down)
    above = height > 0.0
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    flat, height, above = flat[cut], height[cut], above[cut]
    # The corner alone on its side; the two sides of the triangle from it are cut.
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), above.argmin(axis=1))
    row = np.arange(len(cut))
    ends = []
    for other in ((alone + 1) % 3, (alone + 2) % 3):
        part = height[row, alone] / (height[row, alone] - height[row, other])
        ends.append(flat[row, alone] + part[:, None] * (flat[row, other] - flat[row, alone]))
    return np.stack(ends, axis=1)
