"""Planning before the operation: straight needle corridors, approaches that touch nothing.

Pure: no clock, no files. mm and rad; m for sliding joints, as in `app.robot`.
"""

import lazy_loader

# Names of `__init__.pyi` are imported on first use: compiled modules load slowly.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
