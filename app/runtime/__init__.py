"""The application layer: what a session is about, how it is opened, run and changed."""

import lazy_loader

# Import each name of `__init__.pyi` on first access: unused modules are not loaded.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
