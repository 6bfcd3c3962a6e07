"""A live session on the ROS graph: its sources, its outputs, its recorder, its lifecycle."""

from app.bridge.live.lifecycle import LiveNodeLifecycle
from app.bridge.live.live_node import LiveNode, live_node
from app.bridge.live.rearm_client import RearmClient
from app.bridge.live.rearming import RearmService
from app.bridge.live.recorder import RosRecorder, SessionWatch
from app.bridge.live.sources import TfSource, TrackedTransformSource, listen_to_joints, source_of

__all__ = [
    "LiveNode",
    "LiveNodeLifecycle",
    "RearmClient",
    "RearmService",
    "RosRecorder",
    "SessionWatch",
    "TfSource",
    "TrackedTransformSource",
    "listen_to_joints",
    "live_node",
    "source_of",
]
