from .ambf import bodies_from_mesh_map, load_adf, parse_mesh_map
from .elements import (
    AdfError,
    ClosureType,
    Joint,
    JointDynamics,
    JointError,
    JointType,
    Link,
    LinkInertia,
    LoopClosure,
    Mimic,
    Rgba,
    RobotError,
    RobotMeshError,
    Shape,
    UnreachableError,
    UrdfError,
)
from .inverse_kinematics import IkOptions
from .loading import load_robot, robot_from_text, urdf_text
from .robot import Robot

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
    "robot_from_text",
    "urdf_text",
]
