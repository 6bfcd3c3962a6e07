"""Analysis of a case after the operation: breaches, motion, coverage, uncertainty.

Pure: no clock, no ROS. It reads the steps of a session and evaluates no distance a second time.
"""

import lazy_loader

# Import each name of `__init__.pyi` on first access: unused modules are not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
