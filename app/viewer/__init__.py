"""The page that a surgeon watches: one scene, drawn here, sent to a browser on this machine.

Imports slicer, vtk and trame, which takes some seconds. Knows neither ROS nor files: the command
hands it the steps of a session, recorded or live.
"""

from app.viewer.cast import Cast, stop_surface
from app.viewer.errors import ViewerError
from app.viewer.feeds import LiveFeed, ReplayFeed
from app.viewer.gate import new_token
from app.viewer.server import Address, Title, Viewer
from app.viewer.shown import Shown, Watcher
from app.viewer.stage import Stage
from app.viewer.timeline import LiveTimeline, ReplayTimeline

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
