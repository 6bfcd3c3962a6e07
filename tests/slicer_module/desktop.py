"""TEST DOUBLES of the parts of desktop Slicer that a scripted module needs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def desktop_slicer() -> Iterator[None]:
    """Context in which the file of a module can be loaded. Skips if Qt cannot be loaded."""
    qt_double = pytest.importorskip(
        "tests.slicer_module.qt_double",
        reason="PySide6 cannot be loaded: apt install libegl1 libxkbcommon0 libfontconfig1",
        exc_type=ImportError,
    )
    from tests.slicer_module import slicer_double

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("QT_QPA_PLATFORM", "offscreen")
        application = qt_double.QApplication.instance() or qt_double.QApplication([])
        for name, stand_in in slicer_double.stand_ins().items():
            patch.setitem(sys.modules, name, stand_in)
        yield
        application.processEvents()
