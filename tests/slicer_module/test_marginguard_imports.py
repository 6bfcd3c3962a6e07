"""Imports of the logic of the module, in a Python of its own."""

import pytest

from tests.python_process import run_python
from tests.slicer_module.marginguard_module import FOLDER

pytestmark = pytest.mark.long


def test_logic_imports_nothing_that_desktop_slicer_lacks():
    """The logic imports neither trame nor Qt; matplotlib stays unloaded."""
    code = (
        "import sys\n"
        "sys.modules |= dict.fromkeys(('trame', 'trame_slicer', 'PySide6'))\n"
        "import MarginGuardLib.logic\n"
        "print('matplotlib' in sys.modules)"
    )
    done = run_python("-c", code, status=None, cwd=FOLDER)
    assert done.stdout == "False\n", done.stderr
