"""Planning before the operation: straight needle corridors.

Pure: no clock, no files. Imports `app.geometry`, `app.robot`, `app.fixture` and libraries only.
"""

import lazy_loader

# `__init__.pyi` lists the names. Each is imported on first use: compiled modules load slowly.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
