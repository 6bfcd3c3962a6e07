"""The scene: 3D Slicer's own MRML nodes, and pictures of them.

Only this package and the viewer import slicer and vtk. That takes some seconds, so a program
imports this package when it needs it. MRML scenes are parameters; there is no global one.
"""

import lazy_loader

# Load each name of `__init__.pyi` on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
