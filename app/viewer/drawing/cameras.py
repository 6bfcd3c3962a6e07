"""From where the page looks at its stage."""

from enum import Enum

import numpy as np

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.scene.nodes.convert import world_matrix, world_points
from app.scene.pictures.cameras import VIEW_ANGLE_DEG, bullseye, forward_of, look_through
from app.scene.pictures.framing import Camera, best_direction, fit
from app.scene.scene import MarginGuardScene
from app.viewer.drawing.scene_view import SceneView

_CLOSE_RADII = 2.2
"""Parts of the tool that are within so many radii of the tumour are in the close-up."""
_BULLSEYE_RADII = 6.0
"""How far behind the tip the bullseye looks from."""


class CameraPreset(Enum):
    """The views of the page; the value is the name of the button."""

    OVERVIEW = "Overview"
    CLOSE = "Close-up"
    SIDE = "Side"
    BULLSEYE = "Bullseye"


class CameraController:
    """Puts the camera of a stage where a `CameraPreset` wants it.

    The bullseye rides on the tool until another look is taken or somebody turns the view by hand;
    the others stay where they were put. A tool without a mesh has no direction: its bullseye is
    the close-up.
    """

    def __init__(self, stage: SceneView) -> None:
        self._stage = stage
        self.look: CameraPreset | None = CameraPreset.OVERVIEW
        self._placed = False
        self._up: FloatArray | None = None

    def take(self, look: CameraPreset) -> None:
        """Look from there from the next picture on."""
        self.look, self._placed, self._up = look, False, None
        self._stage.look_along_tool(look is CameraPreset.BULLSEYE)

    def let_go(self) -> None:
        """Somebody moves the camera by hand: stay where they put it."""
        self.look = None

    def place_anew(self) -> None:
        """The picture has other proportions: frame it again."""
        self._placed = False

    def follow(self) -> None:
        """Place the camera for the picture that comes now."""
        scene, tool = self._stage.scene, self._stage.content.tool
        if scene is None or self.look is None:
            return
        if self.look is CameraPreset.BULLSEYE and tool is not None:
            self._put(self._along(scene, tool))
        elif not self._placed:
            self._put(self._framed(scene, self.look))

    def _put(self, camera: Camera) -> None:
        look_through(self._stage.view.get_camera_node(), camera, VIEW_ANGLE_DEG)
        self._stage.view.renderer().ResetCameraClippingRange()
        self._placed = True

    def _along(self, scene: MarginGuardScene, tool: SurfaceMesh) -> Camera:
        pose = world_matrix(scene.tree.node(tool.frame))
        tip = Transform.from_matrix(pose, target="ras", source=tool.frame)
        distance_mm = _BULLSEYE_RADII * _radius_mm(self._stage.content.tumor.vertices_mm)
        camera = bullseye(tip, forward_of(tool), distance_mm=distance_mm, previous_up=self._up)
        self._up = camera.up
        return camera

    def _framed(self, scene: MarginGuardScene, look: CameraPreset) -> Camera:
        tumor, tool = world_points(scene.tumor), world_points(scene.tool)
        up = _up(scene)
        if look is CameraPreset.OVERVIEW:
            models = [model for robot in scene.robots.values() for model in robot.models.values()]
            others = np.concatenate([tool, *(world_points(model) for model in models)])
            towards = best_direction(tumor, others, up)
        else:
            towards = best_direction(tumor, tool, up)
            towards = np.cross(up, towards) if look is CameraPreset.SIDE else towards
            reach = _CLOSE_RADII * _radius_mm(tumor)
            others = tool[np.linalg.norm(tool - tumor.mean(axis=0), axis=1) < reach]
        width, height = self._stage.view.render_window().GetSize()
        points = np.concatenate([tumor, others])
        return fit(points, towards, up, angle_deg=VIEW_ANGLE_DEG, aspect=width / max(height, 1))


def _radius_mm(points_mm: FloatArray) -> float:
    """Of a ball around the middle of ``points_mm`` (n, 3) that holds all of them."""
    return float(np.linalg.norm(points_mm - points_mm.mean(axis=0), axis=1).max())


def _up(scene: MarginGuardScene) -> FloatArray:
    """Robots stand upright, +z of their base; without one the reference's +z is up."""
    nodes = [robot.base for robot in scene.robots.values()]
    axis = world_matrix(nodes[0] if nodes else scene.tree.node(scene.reference))[:3, 2]
    return np.asarray(axis / np.linalg.norm(axis))
