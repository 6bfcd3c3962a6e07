from .address import Address, Role, ViewerError, new_token
from .drawing.scene_view import SceneView
from .feeds import LiveFeed, LiveSteps, ReplayFeed
from .live_operator import LiveOperator
from .pointer_parts import MouseHand
from .server import Title, Viewer
from .timeline import LiveTimeline, ReplayTimeline
from .view_state import ViewState, ViewStateBuilder

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
