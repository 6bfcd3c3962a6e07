"""The ultrasound image as values of the page."""

from typing import Any

import numpy as np

from app.geometry import FloatArray, ImageSample, Pixels
from app.viewer.steps.plane_lines import ImageView, Lines
from app.viewer.steps.view_state import ViewState

_MAX_POINTS = 4000
"""Points of the lines on one image."""


def ultrasound_values(view: ImageView, size: tuple[int, int]) -> dict[str, Any]:
    """The values that the page draws of ``view``; ``size``: columns and rows.

    Paths are those of SVG in pixels, from 0 at the outer edge of the first pixel.
    """
    stamp = None if view.image is None else view.image.stamp
    tip = None if view.tip is None else [round(float(value), 2) for value in view.tip]
    return {
        "number": view.number,
        "width": size[0],
        "height": size[1],
        "problem": view.problem,
        "time": "" if stamp is None else f"{stamp.ns / 1e9:.3f} s{_depth_text(view.depth_mm)}",
        "tumor": svg_path(view.tumor),
        "margin": svg_path(view.margin),
        "tool": svg_path(view.tool),
        "needle": svg_path(view.needle),
        "tip": None if tip is None else [tip[0] + 0.5, tip[1] + 0.5, tip[2]],
        "edges": view.edges,
        "closest": "" if view.closest is None else svg_path((view.closest,)),
    }


def depth_values(shown: ViewState | None) -> dict[str, Any] | None:
    """The listed depths in mm and the one in use for new images; None without several."""
    depth = None if shown is None else shown.content.image_depth
    return None if depth is None else {"depths": list(depth.depths_mm), "used": depth.depth_mm}


def _depth_text(depth_mm: float | None) -> str:
    return "" if depth_mm is None else f", depth {depth_mm:g} mm"


def eight_bits(image: ImageSample) -> Pixels:
    """The pixels in 8 bits; others are stretched from the least to the largest value."""
    pixels = image.pixels
    if pixels is None:
        raise ValueError(f"image {image.number} has no pixels")
    if pixels.dtype == np.uint8:
        return pixels
    low, high = int(pixels.min()), int(pixels.max())
    scaled = (pixels.astype(np.float32) - low) * (255.0 / max(1, high - low))
    return np.round(scaled).astype(np.uint8)


def svg_path(lines: Lines | tuple[FloatArray, ...]) -> str:
    """The path of lines of points (n, 2), at most about `_MAX_POINTS` in all."""
    count = sum(len(line) for line in lines)
    step = max(1, -(-count // _MAX_POINTS))
    return "".join(
        "M" + "L".join(f"{x + 0.5:.2f} {y + 0.5:.2f}" for x, y in _thinned(line, step).tolist())
        for line in lines
    )


def _thinned(line: FloatArray, step: int) -> FloatArray:
    """Every ``step``-th point of ``line``, with the last one, which closes an outline."""
    if step == 1:
        return line
    return np.concatenate([line[:-1:step], line[-1:]])
