"""The surgeon's scene: 3D Slicer's own MRML nodes, and pictures of them.

The only room, beside the viewer, that imports slicer and vtk; that takes some seconds, so a
program imports this room when it needs it. Scenes are handed in, never global.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
