"""One pure step, from a tracker frame to a decision: where the rooms meet.

Registration, robot, case and fixture do not know each other; the session joins them.

Reads no clock and knows neither ROS nor VTK.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
