"""Base error of the ROS interface."""

from app.geometry import MarginGuardError


class BridgeError(MarginGuardError):
    """A ROS operation failed, or a value cannot be converted to a message."""


def reason_of(error: BaseException) -> str:
    """Text of a library's error on one line, for use in our own message."""
    return " ".join(str(error).split())
