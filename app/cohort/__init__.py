"""Cohorts: which cases they have, what is kept of each, and statistics over them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
