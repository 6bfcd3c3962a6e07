"""Error of following a robot."""

from app.bridge.errors import BridgeError


class FollowError(BridgeError):
    """The settings of a followed robot are invalid."""
