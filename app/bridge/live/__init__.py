"""A live session on the ROS graph: its sources, its outputs, its recorder, its lifecycle."""

from app.bridge.live.joints import listen_to_joints
from app.bridge.live.lifecycle import LiveNodeLifecycle
from app.bridge.live.live_node import LiveNode, live_node
from app.bridge.live.rearm_client import RearmClient
from app.bridge.live.rearming import RearmService
from app.bridge.live.recorder import RosRecorder
from app.bridge.live.session_watch import SessionWatch
from app.bridge.live.source import TfSource, TrackedTransformSource, source_of

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
