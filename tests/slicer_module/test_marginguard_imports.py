"""Imports of the logic of the module, in a Python of its own."""

import subprocess
import sys

import pytest

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
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=FOLDER, check=False
    )
    assert done.stdout == "False\n", done.stderr
