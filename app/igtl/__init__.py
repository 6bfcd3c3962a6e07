"""OpenIGTLink: tracked transforms with their status from a PLUS server, or sent as by one.

`framing` does no input or output; `IgtlSource` and `PoseServer` own sockets and a thread.
"""

import lazy_loader

# Names are listed in `__init__.pyi` and loaded on first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
