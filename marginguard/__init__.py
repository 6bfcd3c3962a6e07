"""Python API of MarginGuard: ``import marginguard as mg``.

Open a case, step through it, and read the margin as a table:

>>> import marginguard as mg
>>> case = mg.open_case(mg.example_case())
>>> steps = list(mg.replay(case, start_s=95.0, end_s=100.0))
>>> table = mg.margin_table(steps)
>>> float(table["signed_distance_mm"].min().round(1))
-4.9
>>> [breach.frames for breach in mg.find_breaches(case, steps)]
[40]

The names of ``__all__`` are stable; every other name of this package and of ``app`` may change.
Lengths are in mm, angles in rad, times in s or integer ns; the name of a value ends with its unit.
A wrong value or file raises a `MarginGuardError` with one line; a wrong type may raise `TypeError`
or `AttributeError` of Python. ``docs/python_api.md`` is the guide.
"""

import lazy_loader

from marginguard.app_package import check_app

# Import each name of `__init__.pyi` on first access: `import marginguard` stays fast.
_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> object:
    check_app()
    if name == "__version__":
        from app import __version__ as value
    else:
        value = _load(name)
    globals()[name] = value  # a controller reads names at its rate
    return value
