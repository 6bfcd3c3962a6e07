from .convert import mesh_of_model, mesh_of_segment, points_of_markups
from .image_nodes import ImagePlane, ImageVolume
from .item_models import ContourModel
from .margin_display import BreachMarkers, FixturePlane, MarkerStyle
from .offscreen import OffscreenError, SceneError, load_3d_view_only, use_offscreen_rendering
from .pictures.camera_views import (
    Camera,
    Preset,
    bullseye,
    center_on,
    forward_of,
    look_through,
    preset_camera,
)
from .pictures.movie import movie_gif, movie_mp4
from .pictures.offscreen_view import (
    QUICK_TYPE,
    OffscreenView,
    SceneApplication,
    offscreen_view,
    quick_image,
)
from .pictures.picture import StepScene, scene_png, step_png
from .planned_models import PlannedModels
from .presenter import ScenePresenter
from .robot_model import PoseNodes, RobotModel
from .scene import MarginGuardScene
from .scene_file import load_scene, save_scene
from .scene_nodes import Batch
from .sequences import add_sequences
from .shown_margin import TransformHealth, TransformWatchdog
from .simulated_bodies import BodyModels
from .transform_tree import EditedTransform, TransformTree

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
    "PlannedModels",
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
