"""From measurements to transforms, and how far to trust them: pure functions, no clock, no files.

Imports `app.geometry` only. Every result says whether it is accepted and why; what cannot be
computed is refused with an error that names the cause.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
