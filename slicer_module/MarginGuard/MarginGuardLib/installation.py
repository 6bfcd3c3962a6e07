"""Check that this Slicer's Python can load MarginGuard. This file runs on any Python 3."""

import sys
from importlib import import_module

OLDEST = (3, 11)
_REQUIRED = {
    "app.session": "MarginGuard",
    "app.bridge": "ROS 2",
    "MarginGuardLib.logic": "the panel's logic",
}
_START = "start Slicer with 'marginguard slicer --slicer PATH'"


def missing_requirement() -> str:
    """Return one line about what is missing and the remedy; empty if nothing is."""
    if sys.version_info < OLDEST:
        found, oldest = (".".join(map(str, each[:2])) for each in (sys.version_info, OLDEST))
        return f"MarginGuard needs Python {oldest} or later; this Slicer has {found}"
    for name, what in _REQUIRED.items():
        try:
            import_module(name)
        except Exception as error:  # incompatible packages fail with any type of error
            reason = " ".join(str(error).split()) or type(error).__name__
            return f"{what} cannot be loaded ({reason}): {_START}"
    return ""
