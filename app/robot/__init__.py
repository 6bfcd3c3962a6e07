"""Robots: links with surfaces, forward and inverse kinematics, from URDF files.

mm and radians inside; metres only in URDF files and in the positions of sliding joints, as in ROS.
"""

from app.robot.errors import (
    JointError,
    RobotError,
    RobotMeshError,
    UnreachableError,
    UrdfError,
)
from app.robot.inverse import IkOptions
from app.robot.joint import Joint, JointType, Mimic
from app.robot.loading import load_robot
from app.robot.robot import Robot
from app.robot.shapes import Link, Rgba, Shape

__all__ = [
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
    "load_robot",
]
