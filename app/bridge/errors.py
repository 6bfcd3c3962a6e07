"""The errors of the bridge."""

from app.geometry import MarginGuardError


class BridgeError(MarginGuardError):
    """ROS 2 cannot be used as asked, or a value cannot be put into a message."""


def reason_of(error: BaseException) -> str:
    """What a library says is wrong, on one line, for an error of our own."""
    return " ".join(str(error).split())
