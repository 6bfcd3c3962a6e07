"""Registrations and calibrations with their uncertainty.

Pure functions that read no clock and no files. Imports `app.geometry` only. Every result has a
flag ``accepted`` and a reason. Input from which no result can be computed raises an error whose
type names the cause.
"""

import lazy_loader

# Names of `__init__.pyi` are imported on first access: scipy and trimesh take long to load.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
