"""Robots: links with surfaces, forward and inverse kinematics, from URDF, xacro and AMBF files.

mm and radians inside; metres only in URDF files and in the positions of sliding joints, as in ROS.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
