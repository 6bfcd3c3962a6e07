"""tf: a transform buffer that needs no node, a listener and broadcasters."""

from app.bridge.tf.buffer import Lookup, PoseSet, TransformBuffer
from app.bridge.tf.errors import (
    TfConnectivityError,
    TfError,
    TfExtrapolationError,
    TfInvalidError,
    TfLookupError,
)
from app.bridge.tf.pose import Pose

__all__ = [
    "Lookup",
    "Pose",
    "PoseSet",
    "TfConnectivityError",
    "TfError",
    "TfExtrapolationError",
    "TfInvalidError",
    "TfLookupError",
    "TransformBuffer",
]
