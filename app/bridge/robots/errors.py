"""What can be wrong with following a robot."""

from app.bridge.errors import BridgeError


class FollowError(BridgeError):
    """A robot cannot be followed as asked."""
