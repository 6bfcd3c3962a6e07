"""Report of a replay: JSON summary, CSV table, plots and an HTML page.

The plots load matplotlib; import them from their own modules where they are drawn.
"""

import lazy_loader

# Import each name of `__init__.pyi` on first access: unused modules are not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
