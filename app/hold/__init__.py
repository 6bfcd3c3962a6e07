"""The hold of a session: what latches it, its causes, its identity, its re-arm, its record.

`Hold` is the state machine. `HoldIdentity` names the hold that an operator has seen. `LiveState`
keeps it on disk, so that it survives the process.
"""

import lazy_loader

# Names are loaded on first use, as listed in `__init__.pyi`.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
