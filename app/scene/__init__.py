"""The surgeon's scene: 3D Slicer's own MRML nodes, and pictures of them.

The only room, beside the viewer, that imports slicer and vtk; that takes some seconds, so a
program imports this room when it needs it. Scenes are handed in, never global.
"""

from app.scene.application import SceneApplication
from app.scene.batch import Batch
from app.scene.breach_markers import BreachMarkers
from app.scene.cameras import Preset, bullseye, forward_of, look_through, preset_camera
from app.scene.edited import (
    EditedTransform,
    mesh_of_model,
    mesh_of_segment,
    points_of_markups,
)
from app.scene.errors import OffscreenError, SceneError
from app.scene.fixture_plane import FixturePlane
from app.scene.framing import Camera
from app.scene.moment import Moment, MomentScene, ShownRobot, moment_png
from app.scene.movie import movie_gif
from app.scene.offscreen import use_offscreen_rendering
from app.scene.picture import scene_png
from app.scene.poses import PoseNodes
from app.scene.robot_model import RobotModel
from app.scene.scene import MarginGuardScene
from app.scene.scene_file import load_scene, save_scene
from app.scene.sequences import add_sequences
from app.scene.transform_tree import TransformTree
from app.scene.view import OffscreenView, draw_once_an_update, offscreen_view
from app.scene.watchdog import Freshness, TransformHealth, TransformWatchdog

__all__ = [
    "Batch",
    "BreachMarkers",
    "Camera",
    "EditedTransform",
    "FixturePlane",
    "Freshness",
    "MarginGuardScene",
    "Moment",
    "MomentScene",
    "OffscreenError",
    "OffscreenView",
    "PoseNodes",
    "Preset",
    "RobotModel",
    "SceneApplication",
    "SceneError",
    "ShownRobot",
    "TransformHealth",
    "TransformTree",
    "TransformWatchdog",
    "add_sequences",
    "bullseye",
    "draw_once_an_update",
    "forward_of",
    "load_scene",
    "look_through",
    "mesh_of_model",
    "mesh_of_segment",
    "moment_png",
    "movie_gif",
    "offscreen_view",
    "points_of_markups",
    "preset_camera",
    "save_scene",
    "scene_png",
    "use_offscreen_rendering",
]
