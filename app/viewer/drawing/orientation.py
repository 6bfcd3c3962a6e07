"""Orientation letters and scale bar of the picture, for the camera that draws it."""

from typing import Any

import numpy as np

from app.geometry import ANATOMICAL_AXES, FloatArray
from app.scene.convert import world_matrix
from app.viewer.drawing.scene_view import SceneView

_LENGTHS_MM = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_MAX_SHARE = 0.22
"""Largest length of the bar, as a part of the picture's height."""


def orientation(view: SceneView) -> dict[str, Any] | None:
    """The letters of the axes of the tumour's frame and the scale at the tumour; None without it.

    ``letters`` are sorted from far to near: each with ``x`` (right), ``y`` (down) and ``z`` (to the
    viewer) of its unit vector in the picture. ``width`` and ``height`` of the picture in
    pixels; ``bar_mm`` is the length of the bar, ``bar_px`` its pixels at the middle of the tumour.
    """
    scene = view.scene
    if scene is None or scene.tumor is None or scene.tumor.GetParentTransformNode() is None:
        return None
    camera = view.view.renderer().GetActiveCamera()
    matrix = world_matrix(scene.tumor.GetParentTransformNode())
    axes = camera_axes(
        np.array(camera.GetPosition()),
        np.array(camera.GetFocalPoint()),
        np.array(camera.GetViewUp()),
    )
    low, high = (
        view.content.tumor.vertices_mm.min(axis=0),
        view.content.tumor.vertices_mm.max(axis=0),
    )
    middle = matrix[:3, :3] @ (0.5 * (low + high)) + matrix[:3, 3]
    depth_mm = float(-axes[2] @ (middle - np.array(camera.GetPosition())))
    width, height = view.view.render_window().GetSize()
    bar_mm, bar_px = scale_bar(depth_mm, camera.GetViewAngle(), height)
    return {
        "letters": axis_letters(axes @ matrix[:3, :3]),
        "width": width,
        "height": height,
        "bar_mm": bar_mm,
        "bar_px": round(bar_px, 1),
    }


def camera_axes(position: FloatArray, focal_point: FloatArray, up: FloatArray) -> FloatArray:
    """Right, up and towards the viewer as rows (3, 3), unit vectors, from points (3,) in mm."""
    towards = position - focal_point
    towards = towards / np.linalg.norm(towards)
    right = np.cross(up, towards)
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(towards, right), towards])


def axis_letters(picture_from_ras: FloatArray) -> list[dict[str, str | float]]:
    """The six letters with their directions in the picture, from far to near."""
    placed = [
        (letter, picture_from_ras @ direction) for letter, direction in ANATOMICAL_AXES.items()
    ]
    return [
        {
            "letter": letter,
            "x": round(float(x), 3),
            "y": round(float(-y), 3),
            "z": round(float(z), 3),
        }
        for letter, (x, y, z) in sorted(placed, key=lambda each: float(each[1][2]))
    ]


def scale_bar(depth_mm: float, view_angle_deg: float, height_px: int) -> tuple[int, float]:
    """Length in mm and in pixels of a bar at ``depth_mm`` before the camera; (0, 0) behind it.

    ``view_angle_deg`` is the vertical angle of a perspective camera.
    """
    if depth_mm <= 0.0 or height_px <= 0:
        return 0, 0.0
    px_per_mm = height_px / (2.0 * depth_mm * np.tan(np.radians(view_angle_deg) / 2.0))
    fitting = [mm for mm in _LENGTHS_MM if mm * px_per_mm <= _MAX_SHARE * height_px]
    length_mm = fitting[-1] if fitting else 0
    return length_mm, float(length_mm * px_per_mm)
