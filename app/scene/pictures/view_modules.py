"""Loads the 3D view of trame-slicer without its other views, for a process that only draws."""

import sys
from importlib.util import find_spec
from types import ModuleType

_VIEWS = "trame_slicer.views"
_SERVER = ("trame_server", "trame_server.utils")


def load_3d_view_only() -> None:
    """Let `trame_slicer.views` have no content of its own, only its submodules.

    Its ``__init__`` loads slice views with all of VTK, and the web server, which takes half a
    second of processor time. Call it before the first view; the process cannot serve pages then.
    """
    spec = find_spec(_VIEWS)
    if spec is None or _VIEWS in sys.modules or _SERVER[0] in sys.modules:
        return
    package = ModuleType(_VIEWS)
    package.__path__ = list(spec.submodule_search_locations or ())
    sys.modules[_VIEWS] = package
    # Used by a render scheduler that an offscreen view does not have.
    server, utils = (ModuleType(name) for name in _SERVER)
    utils.asynchronous = None  # type: ignore[attr-defined]
    server.utils = utils  # type: ignore[attr-defined]
    sys.modules.update(dict(zip(_SERVER, (server, utils), strict=True)))
