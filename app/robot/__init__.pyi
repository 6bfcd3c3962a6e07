from .description.ambf import bodies_from_mesh_map, load_adf, parse_mesh_map
from .description.loading import load_robot, robot_from_text, urdf_text
from .description.xacro_file import parse_xacro_args
from .dynamics import JointDynamics, LinkInertia
from .errors import (
    AdfError,
    JointError,
    RobotError,
    RobotMeshError,
    UnreachableError,
    UrdfError,
)
from .kinematics.closure import ClosureType, LoopClosure
from .kinematics.inverse import IkOptions
from .kinematics.joint import Joint, JointType, Mimic
from .robot import Robot
from .shapes import Link, Rgba, Shape

__all__ = [
    "AdfError",
    "ClosureType",
    "IkOptions",
    "Joint",
    "JointDynamics",
    "JointError",
    "JointType",
    "Link",
    "LinkInertia",
    "LoopClosure",
    "Mimic",
    "Rgba",
    "Robot",
    "RobotError",
    "RobotMeshError",
    "Shape",
    "UnreachableError",
    "UrdfError",
    "bodies_from_mesh_map",
    "load_adf",
    "load_robot",
    "parse_mesh_map",
    "parse_xacro_args",
    "robot_from_text",
    "urdf_text",
]
