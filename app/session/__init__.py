"""One pure step from a tracker frame to a decision.

Joins registration, robot, case and fixture, which do not import each other. Reads no clock and
depends neither on ROS nor on VTK.
"""

import lazy_loader

# Names are loaded on first use, as listed in `__init__.pyi`.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
