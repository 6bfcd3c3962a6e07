from .application import SceneApplication
from .batch import Batch
from .breach_markers import BreachMarkers
from .cameras import Preset, bullseye, forward_of, look_through, preset_camera
from .edited import (
    EditedTransform,
    mesh_of_model,
    mesh_of_segment,
    points_of_markups,
)
from .errors import OffscreenError, SceneError
from .fixture_plane import FixturePlane
from .framing import Camera
from .moment import Moment, MomentScene, ShownRobot, moment_png
from .movie import movie_gif
from .offscreen import use_offscreen_rendering
from .picture import scene_png
from .poses import PoseNodes
from .robot_model import RobotModel
from .scene import MarginGuardScene
from .scene_file import load_scene, save_scene
from .sequences import add_sequences
from .transform_tree import TransformTree
from .view import OffscreenView, draw_once_an_update, offscreen_view
from .watchdog import Freshness, TransformHealth, TransformWatchdog

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
