from .access.role import Role
from .address import Address, new_token
from .drawing.scene_view import SceneView
from .errors import ViewerError
from .readout.timeline import LiveTimeline, ReplayTimeline
from .server import Title, Viewer
from .steps.feeds import LiveFeed, ReplayFeed
from .steps.live_operator import LiveOperator
from .steps.live_steps import LiveSteps
from .steps.mouse_hand import MouseHand
from .steps.view_state import ViewState, ViewStateBuilder

__all__ = [
    "Address",
    "LiveFeed",
    "LiveOperator",
    "LiveSteps",
    "LiveTimeline",
    "MouseHand",
    "ReplayFeed",
    "ReplayTimeline",
    "Role",
    "SceneView",
    "Title",
    "ViewState",
    "ViewStateBuilder",
    "Viewer",
    "ViewerError",
    "new_token",
]
