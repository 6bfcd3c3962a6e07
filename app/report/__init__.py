"""What remains of a replay: numbers, a table, pictures and a page.

The plots, which load matplotlib, are imported from their own files where they are drawn.
"""

import lazy_loader

# By `__init__.pyi`, each name when it is asked for: what a program does not use is not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
