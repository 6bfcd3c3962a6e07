"""MarginGuard: image-guided robotic intervention between ROS 2 and 3D Slicer.

The rooms and the direction of their imports are drawn in ``docs/architecture.md``.
"""

__version__ = "0.1.0"
