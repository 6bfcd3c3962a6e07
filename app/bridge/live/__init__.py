"""A live session on the ROS graph: where its samples come from, what an operator may do to it."""

from app.bridge.live.joints import listen_to_joints
from app.bridge.live.lifecycle import LiveNodeLifecycle
from app.bridge.live.live_node import LiveNode, guarding
from app.bridge.live.rearming import RearmService
from app.bridge.live.recorder import RosRecorder
from app.bridge.live.session_watch import SessionWatch
from app.bridge.live.source import Source, TfSource, TrackedTransformSource, source_of

__all__ = [
    "LiveNode",
    "LiveNodeLifecycle",
    "RearmService",
    "RosRecorder",
    "SessionWatch",
    "Source",
    "TfSource",
    "TrackedTransformSource",
    "guarding",
    "listen_to_joints",
    "source_of",
]
