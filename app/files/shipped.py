"""Files that MarginGuard ships beside its code: data, Slicer modules, RViz, Foxglove, benchmarks.

The folders are below the project's root in a checkout and in an editable installation. A wheel
holds them in ``app/share``, where ``tools/build_py.py`` copies them.
"""

from importlib.resources import files
from pathlib import Path

_PACKAGE = Path(str(files("app")))
_SHARE = _PACKAGE / "share"


def checkout() -> Path | None:
    """Root of the checkout that contains this code; None if it was installed from a wheel.

    An editable installation (``pip install -e``) runs the code of its checkout.
    """
    return None if _SHARE.is_dir() else _PACKAGE.parent


def shipped(*parts: str) -> Path:
    """Path of a shipped file or folder: ``shipped("data", "recorded_case")``. May not exist."""
    return (checkout() or _SHARE).joinpath(*parts)
