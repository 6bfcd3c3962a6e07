"""Cameras of the page."""

from enum import Enum

import numpy as np

from app.geometry import FloatArray, SurfaceMesh, Transform
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
