"""The surgeon's scene: 3D Slicer's own MRML nodes, and pictures of them.

The only room, beside the viewer, that imports slicer and vtk; that takes some seconds, so a
program imports this room when it needs it. Scenes are handed in, never global.
"""

from app.scene.application import SceneApplication
from app.scene.errors import OffscreenError, SceneError
from app.scene.moment import Moment, ShownRobot, moment_png
from app.scene.offscreen import use_offscreen_rendering
from app.scene.picture import scene_png
from app.scene.poses import PoseNodes
from app.scene.robot_model import RobotModel
from app.scene.scene import MarginGuardScene
from app.scene.transform_tree import TransformTree
from app.scene.view import OffscreenView, offscreen_view

__all__ = [
    "MarginGuardScene",
    "Moment",
    "OffscreenError",
    "OffscreenView",
    "PoseNodes",
    "RobotModel",
    "SceneApplication",
    "SceneError",
    "ShownRobot",
    "TransformTree",
    "moment_png",
    "offscreen_view",
    "scene_png",
    "use_offscreen_rendering",
]
