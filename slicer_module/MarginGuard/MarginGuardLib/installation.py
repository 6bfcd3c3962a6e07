"""Check that MarginGuard can be imported by this Slicer's Python. This file runs on any Python."""

import sys
from importlib import import_module

OLDEST = (3, 11)
_NEEDED = {
    "app.session": "MarginGuard",
    "app.bridge": "ROS 2",
    "MarginGuardLib.logic": "the panel's logic",
}
_START = "start Slicer with 'marginguard slicer --slicer PATH'"


def missing_requirement() -> str:
    """One line with the missing requirement; empty if the module can work."""
    if sys.version_info < OLDEST:
        found, oldest = (".".join(map(str, each[:2])) for each in (sys.version_info, OLDEST))
        return f"MarginGuard needs Python {oldest} or later; this Slicer has {found}"
    for name, what in _NEEDED.items():
        try:
            import_module(name)
        except Exception as error:  # packages that do not fit this Slicer fail in many ways
            reason = " ".join(str(error).split()) or type(error).__name__
            return f"{what} cannot be loaded ({reason}): {_START}"
    return ""
