"""What can be wrong with a robot: its description, its meshes, the joints asked for."""

from app.geometry import InputError, MarginGuardError


class RobotError(MarginGuardError):
    """Root of the errors of this room."""


class UrdfError(RobotError, InputError):
    """A robot description that cannot be used: unsafe, malformed, or not one tree of links."""


class AdfError(RobotError, InputError):
    """An AMBF description file that cannot be used: malformed, or not trees of bodies."""


class RobotMeshError(RobotError, InputError):
    """A mesh of a robot that is missing, outside its package, of no known format, or broken."""


class JointError(RobotError, InputError):
    """A joint or link name that the robot does not have, or a position that is not a number."""


class UnreachableError(RobotError):
    """Inverse kinematics found no joint positions within their limits for the wanted pose."""
