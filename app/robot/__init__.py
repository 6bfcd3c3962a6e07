"""Robots: links with surfaces, forward and inverse kinematics, from URDF, xacro and AMBF files.

mm and radians inside; metres only in URDF files and in the positions of sliding joints, as in ROS.
"""

import lazy_loader

# Names of `__init__.pyi` are imported on first use, so that a program loads only what it uses.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
