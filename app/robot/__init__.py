"""Robots: links with surfaces, forward and inverse kinematics, from URDF, xacro and AMBF files.

mm and radians inside; metres only in URDF files and in the positions of sliding joints, as in ROS.
"""

from app.robot.ambf import bodies_from_mesh_map, load_adf, parse_mesh_map
from app.robot.errors import (
    AdfError,
    JointError,
    RobotError,
    RobotMeshError,
    UnreachableError,
    UrdfError,
)
from app.robot.inverse import IkOptions
from app.robot.joint import Joint, JointType, Mimic
from app.robot.loading import load_robot, robot_from_text, urdf_text
from app.robot.robot import Robot
from app.robot.shapes import Link, Rgba, Shape
from app.robot.xacro_file import parse_xacro_args

__all__ = [
    "AdfError",
    "IkOptions",
    "Joint",
    "JointError",
    "JointType",
    "Link",
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
