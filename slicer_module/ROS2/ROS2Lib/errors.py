"""Errors of the ROS2 module."""

from app.geometry import MarginGuardError


class Ros2Error(MarginGuardError):
    """Invalid call: a name in use, a node outside the ROS graph, a value of another type."""
