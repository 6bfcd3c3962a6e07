"""The page that a surgeon watches: one scene, drawn here, sent to a browser on this machine.

Most of it imports slicer, vtk and trame, which takes some seconds. Knows neither ROS nor files: the
command hands it the steps of a session, recorded or live.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
