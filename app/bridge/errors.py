"""The errors of the bridge."""

from app.geometry import MarginGuardError


class BridgeError(MarginGuardError):
    """ROS 2 cannot be used as asked, or a value cannot be put into a message."""
