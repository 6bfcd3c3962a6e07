"""One strict reader for each kind of file, with bounds, and atomic writers."""

import lazy_loader

# Names of `__init__.pyi` are imported on first use, so that a program loads only what it uses.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
