from .address import Address, new_token
from .drawing.stage import Stage
from .errors import ViewerError
from .said.timeline import LiveTimeline, ReplayTimeline
from .server import Title, Viewer
from .steps.cast import Cast, stop_surface
from .steps.feeds import LiveFeed, ReplayFeed
from .steps.shown import Shown, Watcher

__all__ = [
    "Address",
    "Cast",
    "LiveFeed",
    "LiveTimeline",
    "ReplayFeed",
    "ReplayTimeline",
    "Shown",
    "Stage",
    "Title",
    "Viewer",
    "ViewerError",
    "Watcher",
    "new_token",
    "stop_surface",
]
