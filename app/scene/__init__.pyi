from .application import SceneApplication
from .body_models import BodyModels
from .contour_model import ContourModel
from .errors import OffscreenError, SceneError
from .frames.edited import EditedTransform
from .frames.poses import PoseNodes
from .frames.transform_tree import TransformTree
from .frames.watchdog import TransformHealth, TransformWatchdog
from .image_plane import ImagePlane
from .image_volume import ImageVolume
from .margin.breach_markers import BreachMarkers, MarkerStyle
from .margin.fixture_plane import FixturePlane
from .nodes.batch import Batch
from .nodes.shapes import mesh_of_model, mesh_of_segment, points_of_markups
from .pictures.cameras import Preset, bullseye, center_on, forward_of, look_through, preset_camera
from .pictures.framing import Camera
from .pictures.movie import movie_gif, movie_mp4
from .pictures.offscreen import use_offscreen_rendering
from .pictures.picture import scene_png
from .pictures.quick_image import QUICK_TYPE, quick_image
from .pictures.step_scene import StepScene, step_png
from .pictures.view import OffscreenView, draw_once_per_update, offscreen_view
from .pictures.view_modules import load_3d_view_only
from .presenter import ScenePresenter
from .robot_model import RobotModel
from .scene import MarginGuardScene
from .scene_file import load_scene, save_scene
from .sequences import add_sequences

__all__ = [
    "QUICK_TYPE",
    "Batch",
    "BodyModels",
    "BreachMarkers",
    "Camera",
    "ContourModel",
    "EditedTransform",
    "FixturePlane",
    "ImagePlane",
    "ImageVolume",
    "MarginGuardScene",
    "MarkerStyle",
    "OffscreenError",
    "OffscreenView",
    "PoseNodes",
    "Preset",
    "RobotModel",
    "SceneApplication",
    "SceneError",
    "ScenePresenter",
    "StepScene",
    "TransformHealth",
    "TransformTree",
    "TransformWatchdog",
    "add_sequences",
    "bullseye",
    "center_on",
    "draw_once_per_update",
    "forward_of",
    "load_3d_view_only",
    "load_scene",
    "look_through",
    "mesh_of_model",
    "mesh_of_segment",
    "movie_gif",
    "movie_mp4",
    "offscreen_view",
    "points_of_markups",
    "preset_camera",
    "quick_image",
    "save_scene",
    "scene_png",
    "step_png",
    "use_offscreen_rendering",
]
