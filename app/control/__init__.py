"""Cooperative control: from a hand's wrench to joint velocities that the fixture allows.

Pure: no clock and no ROS; every time is passed in.
"""

import lazy_loader

# Names of `__init__.pyi` are imported on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
