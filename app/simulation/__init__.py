"""Simulated worlds: robots, rigid bodies and moving tissue on the physics engine MuJoCo.

mm, rad and integer ns outside, metres inside. No clock and no ROS: the caller steps the world.
"""

import lazy_loader

# Names of `__init__.pyi` are imported on first use: a reader of world files needs no physics.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
