"""Discovery of the calibration methods."""

import importlib
import pkgutil

from app.cli.calibration import methods
from app.cli.calibration.calibration_method import CalibrationMethod


def load_methods() -> dict[str, CalibrationMethod]:
    """Return the ``METHOD`` of every module in `app.cli.calibration.methods`, sorted by name."""
    found: dict[str, CalibrationMethod] = {}
    for module in pkgutil.iter_modules(methods.__path__):
        path = f"{methods.__name__}.{module.name}"
        method: CalibrationMethod = importlib.import_module(path).METHOD
        if method.name in found:
            raise ValueError(f"{path}: calibration method {method.name!r} is defined twice")
        found[method.name] = method
    return dict(sorted(found.items()))
