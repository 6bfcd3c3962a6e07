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
    sees,
)
from app.scene.pictures.picture import up_direction
from app.scene.scene import MarginGuardScene
from app.viewer.drawing.scene_view import SceneView

_CLOSE_MM = 80.0
"""Farthest point of the tool that the close-up contains, from the middle of the tumour."""
_CLOSER = 0.75
"""The close-up is placed again where it could be so much nearer."""
_BULLSEYE_RADII = 6.0
"""Distance of the bullseye's camera from the tip, in tumour radii."""


class CameraPreset(Enum):
    """A view of the page; the value is the label of its button."""

    CLOSE = "Close-up"
    OVERVIEW = "Overview"
    SIDE = "Side"
    BULLSEYE = "Bullseye"


class CameraController:
    """Places the camera of ``view`` as the chosen `CameraPreset` demands.

    Close-up and side view contain tumour and tip: they are placed again, in the same direction,
    when one of them leaves the picture, and when they could be much larger; the robot is in an
    inset, unless ``has_inset`` is False. The bullseye follows the tool; a tool without a mesh has
    no direction: its bullseye is the close-up. The overview is placed once. ``preset`` is None
    after the user has moved the camera, which ends all of that. ``keeps_tumor``: the middle of the
    tumour stays in the middle of the picture, except in the bullseye.
    """

    def __init__(self, view: SceneView, *, has_inset: bool = True) -> None:
        self._view = view
        self._has_inset = has_inset
        self._is_close = True
        self.preset: CameraPreset | None = CameraPreset.CLOSE
        self.keeps_tumor = False
        self._is_placed = False
        self._up: FloatArray | None = None
        self._towards: FloatArray | None = None
        self._camera: Camera | None = None

    def select(self, preset: CameraPreset) -> None:
        """Use ``preset`` from the next picture on."""
        self.preset, self._is_placed, self._up, self._towards = preset, False, None, None
        self._is_close = preset in (CameraPreset.CLOSE, CameraPreset.SIDE)
        self._view.look_along_tool(preset is CameraPreset.BULLSEYE)

    def release(self) -> None:
        """Leave the camera to the user, who is moving it."""
        self.preset = None

    def reframe(self) -> None:
        """Place the cameras again, for a picture of another size."""
        self._is_placed = False
        self._view.inset.reframe()

    def frame_added(self) -> None:
        """Place an overview again: other added models are shown."""
        self._view.inset.reframe()
        if self.preset is CameraPreset.OVERVIEW:
            self._is_placed = False

    def update(self) -> None:
        """Place the cameras for the next picture."""
        scene, tool = self._view.scene, self._view.content.tool
        if scene is None:
            self._view.inset.hide()
            return
        if self.preset is CameraPreset.BULLSEYE and tool is not None:
            self._put(self._along(scene, tool))
            self._view.inset.hide()
            return
        if self.preset is CameraPreset.OVERVIEW:
            if not self._is_placed:
                self._put(self._overview(scene))
        elif self.preset is not None:
            self._follow(scene, self.preset)
        if self.keeps_tumor and scene.tumor is not None:
            center_on(self._view.view.get_camera_node(), world_points(scene.tumor).mean(axis=0))
            self._view.view.renderer().ResetCameraClippingRange()
        self._update_inset(scene)

    def _update_inset(self, scene: MarginGuardScene) -> None:
        inset, links, others = self._view.inset, self._view.links, self._view.others
        if self._has_inset and self._is_close and (links or others):
            tumor, tip = world_points(scene.tumor), _tip_mm(scene, self._view.content.tool)
            points = np.vstack([tip, _ball(tumor.mean(axis=0), 0.8 * _radius_mm(tumor))])
            inset.show(scene, links, others, lambda: self._overview(scene), points)
        else:
            inset.hide()

    def _put(self, camera: Camera) -> None:
        look_through(self._view.view.get_camera_node(), camera, VIEW_ANGLE_DEG)
        self._view.view.renderer().ResetCameraClippingRange()
        self._is_placed, self._camera = True, camera

    def _along(self, scene: MarginGuardScene, tool: SurfaceMesh) -> Camera:
        pose = world_matrix(scene.tree.node(tool.frame))
        tip = Transform.from_matrix(pose, target="ras", source=tool.frame)
        distance_mm = _BULLSEYE_RADII * _radius_mm(self._view.content.tumor.vertices_mm)
        camera = bullseye(tip, forward_of(tool), distance_mm=distance_mm, previous_up=self._up)
        self._up = camera.up
        return camera

    def _follow(self, scene: MarginGuardScene, preset: CameraPreset) -> None:
        """Place the close-up or the side view, if it has to be."""
        tumor, tip = world_points(scene.tumor), _tip_mm(scene, self._view.content.tool)
        if self._towards is None:
            up = up_direction(scene)
            towards = best_direction(tumor, world_points(scene.tool), up)
            towards = np.cross(up, towards) if preset is CameraPreset.SIDE else towards
            self._towards = np.asarray(towards / np.linalg.norm(towards))
        middle, radius = tumor.mean(axis=0), _radius_mm(tumor)
        shaft = tip - middle
        reach = min(float(np.linalg.norm(shaft)), _CLOSE_MM)
        end = middle + shaft * (reach / max(float(np.linalg.norm(shaft)), 1e-9))
        points = np.concatenate([tumor, _ball(end, 0.5 * radius), _ball(middle, 1.2 * radius)])
        needed = self._fit(points, self._towards, up_direction(scene))
        placed = self._camera
        if self._is_placed and placed is not None:
            nearer = _distance(needed) < _CLOSER * _distance(placed)
            seen = sees(
                placed, np.vstack([tumor, end]), angle_deg=VIEW_ANGLE_DEG, aspect=self._aspect
            )
            if seen and not nearer:
                return
        self._put(needed)

    def _fit(self, points: FloatArray, towards: FloatArray, up: FloatArray) -> Camera:
        return fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=self._aspect)

    def _overview(self, scene: MarginGuardScene) -> Camera:
        """A camera that shows tumour, tool, robot and what is added, such as bodies."""
        tumor, up = world_points(scene.tumor), up_direction(scene)
        models = [scene.tool, *self._view.links, *self._view.others]
        others = np.concatenate([world_points(model) for model in models])
        points = np.concatenate([tumor, others])
        return self._fit(points, best_direction(tumor, others, up), up)

    @property
    def _aspect(self) -> float:
        width, height = self._view.view.render_window().GetSize()
        return float(width / max(height, 1))


def _tip_mm(scene: MarginGuardScene, tool: SurfaceMesh | None) -> FloatArray:
    """The origin (3,) of the tool's frame, where its tip is."""
    if tool is None:
        return np.asarray(world_points(scene.tool).mean(axis=0))
    return np.asarray(world_matrix(scene.tree.node(tool.frame))[:3, 3])


def _ball(middle: FloatArray, radius_mm: float) -> FloatArray:
    """The six ends (6, 3) of the axes of a ball."""
    return middle + radius_mm * np.concatenate([np.eye(3), -np.eye(3)])


def _distance(camera: Camera) -> float:
    return float(np.linalg.norm(camera.position - camera.focal_point))


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
    low, high = view.content.tumor.bounds_mm
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
