"""What the ROS2 module refuses."""

from app.geometry import MarginGuardError


class Ros2Error(MarginGuardError):
    """A call that cannot be done: a name in use, a node not on ROS, a value of another type."""
