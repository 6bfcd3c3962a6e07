"""A simulated lumpectomy with ground truth, which the demo replays."""

import lazy_loader

# Names are listed in `__init__.pyi` and loaded on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
