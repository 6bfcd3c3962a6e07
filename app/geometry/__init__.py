"""Values that all packages share: frames, stamps, transforms, meshes, errors.

Units are mm, rad and integer ns. Imports numpy and scipy only, beside the loader of the stubs.
"""

import lazy_loader

# Names are listed in `__init__.pyi` and loaded on first use: an error needs no numpy.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
