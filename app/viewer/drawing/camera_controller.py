"""Cameras of the page, orientation letters and scale bar."""

from enum import Enum
from typing import Any

import numpy as np

from app.geometry import ANATOMICAL_AXES, FloatArray, SurfaceMesh, Transform
from app.scene.convert import world_matrix, world_points
from app.scene.pictures.camera_views import (
    VIEW_ANGLE_DEG,
    Camera,
    best_direction,
    bullseye,
    center_on,
    fit,
    forward_of,
    look_through,
)
from app.scene.pictures.picture import up_direction
from app.scene.scene import MarginGuardScene
from app.viewer.drawing.scene_view import SceneView

_CLOSE_RADII = 2.2
"""The close-up contains the parts of the tool within this many tumour radii."""
_BULLSEYE_RADII = 6.0
"""Distance of the bullseye's camera from the tip, in tumour radii."""


class CameraPreset(Enum):
    """A view of the page; the value is the label of its button."""

    OVERVIEW = "Overview"
    CLOSE = "Close-up"
    SIDE = "Side"
    BULLSEYE = "Bullseye"


class CameraController:
    """Places the camera of ``view`` as the chosen `CameraPreset` demands.

    The bullseye follows the tool until another preset is selected or the user moves the camera; the
    other presets place the camera once. A tool without a mesh has no direction: its bullseye is the
    close-up. ``preset`` is None after the user has moved the camera. ``keeps_tumor``: the middle of
    the tumour stays in the middle of the picture, except in the bullseye, which follows the tool.
    """

    def __init__(self, view: SceneView) -> None:
        self._view = view
        self.preset: CameraPreset | None = CameraPreset.OVERVIEW
        self.keeps_tumor = False
        self._is_placed = False
        self._up: FloatArray | None = None

    def select(self, preset: CameraPreset) -> None:
        """Use ``preset`` from the next picture on."""
        self.preset, self._is_placed, self._up = preset, False, None
        self._view.look_along_tool(preset is CameraPreset.BULLSEYE)

    def release(self) -> None:
        """Leave the camera to the user, who is moving it."""
        self.preset = None

    def reframe(self) -> None:
        """Place the camera again, for a picture of another size."""
        self._is_placed = False

    def frame_bodies(self) -> None:
        """Place an overview again: other bodies of a simulated world are shown."""
        if self.preset is CameraPreset.OVERVIEW:
            self.reframe()

    def update(self) -> None:
        """Place the camera for the next picture."""
        scene, tool = self._view.scene, self._view.content.tool
        if scene is None:
            return
        if self.preset is CameraPreset.BULLSEYE and tool is not None:
            self._put(self._along(scene, tool))
            return
        if self.preset is not None and not self._is_placed:
            self._put(self._framed(scene, self.preset))
        if self.keeps_tumor and scene.tumor is not None:
            center_on(self._view.view.get_camera_node(), world_points(scene.tumor).mean(axis=0))
            self._view.view.renderer().ResetCameraClippingRange()

    def _put(self, camera: Camera) -> None:
        look_through(self._view.view.get_camera_node(), camera, VIEW_ANGLE_DEG)
        self._view.view.renderer().ResetCameraClippingRange()
        self._is_placed = True

    def _along(self, scene: MarginGuardScene, tool: SurfaceMesh) -> Camera:
        pose = world_matrix(scene.tree.node(tool.frame))
        tip = Transform.from_matrix(pose, target="ras", source=tool.frame)
        distance_mm = _BULLSEYE_RADII * _radius_mm(self._view.content.tumor.vertices_mm)
        camera = bullseye(tip, forward_of(tool), distance_mm=distance_mm, previous_up=self._up)
        self._up = camera.up
        return camera

    def _framed(self, scene: MarginGuardScene, preset: CameraPreset) -> Camera:
        tumor, tool = world_points(scene.tumor), world_points(scene.tool)
        up = up_direction(scene)
        if preset is CameraPreset.OVERVIEW:
            links = [model for robot in scene.robots.values() for model in robot.models.values()]
            models = [*links, *self._view.bodies.values()]
            others = np.concatenate([tool, *(world_points(model) for model in models)])
            towards = best_direction(tumor, others, up)
        else:
            towards = best_direction(tumor, tool, up)
            towards = np.cross(up, towards) if preset is CameraPreset.SIDE else towards
            reach = _CLOSE_RADII * _radius_mm(tumor)
            others = tool[np.linalg.norm(tool - tumor.mean(axis=0), axis=1) < reach]
        width, height = self._view.view.render_window().GetSize()
        points = np.concatenate([tumor, others])
        return fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=width / max(height, 1))


def _radius_mm(points_mm: FloatArray) -> float:
    """Largest distance of ``points_mm`` (n, 3) from their mean."""
    return float(np.linalg.norm(points_mm - points_mm.mean(axis=0), axis=1).max())


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
