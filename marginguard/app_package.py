"""Check that the top-level package ``app`` is MarginGuard's own.

``app`` is a common name: an ``app.py`` in the current folder, or in a folder of ``PYTHONPATH``,
would be imported instead.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

_OWN = Path(__file__).resolve().parents[1] / "app" / "__init__.py"


def check_app() -> None:
    """Raise `ImportError` with one line if ``import app`` finds other code. Does not run it."""
    if "app" in sys.modules:
        found = getattr(sys.modules["app"], "__file__", None)
    else:
        spec = find_spec("app")
        found = spec.origin if spec is not None else None
    if found is None or Path(found).resolve() != _OWN:
        raise ImportError(
            f"the module 'app' is {found or 'a folder without code'}; expected {_OWN}, which is "
            "part of MarginGuard: rename the other one, or take its folder off Python's path",
            name="app",
        )
