"""Work of operators with a session beside its commands, as displays show it."""

import lazy_loader

# Names are listed in `__init__.pyi` and loaded on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
