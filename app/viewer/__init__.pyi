from .address import Address, new_token
from .cast import Cast, stop_surface
from .errors import ViewerError
from .feeds import LiveFeed, ReplayFeed
from .server import Title, Viewer
from .shown import Shown, Watcher
from .stage import Stage
from .timeline import LiveTimeline, ReplayTimeline

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
