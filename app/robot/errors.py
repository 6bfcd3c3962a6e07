"""Errors of robot descriptions, meshes, joint positions and inverse kinematics."""

from app.geometry import InputError, MarginGuardError


class RobotError(MarginGuardError):
    """Base class of the errors of this package."""


class UrdfError(RobotError, InputError):
    """A robot description is unsafe, malformed, or not one tree of links."""


class AdfError(RobotError, InputError):
    """An AMBF description file is malformed, or does not describe trees of bodies."""


class RobotMeshError(RobotError, InputError):
    """A mesh of a robot is missing, outside its package, of an unknown format, or malformed."""


class JointError(RobotError, InputError):
    """A joint or link is unknown, or a joint position is missing or not a finite number."""


class UnreachableError(RobotError):
    """Inverse kinematics found no joint positions within the limits for a pose."""
