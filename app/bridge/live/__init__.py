"""A live session on the ROS graph: its sources, its outputs, its recorder, its lifecycle."""

from app.bridge.live.live_node import LiveNodeLifecycle, live_node
from app.bridge.live.ros_recorder import RosRecorder, SessionWatch
from app.bridge.live.sources import TfSource, TrackedTransformSource, listen_to_joints, source_of

__all__ = [
    "LiveNodeLifecycle",
    "RosRecorder",
    "SessionWatch",
    "TfSource",
    "TrackedTransformSource",
    "listen_to_joints",
    "live_node",
    "source_of",
]
