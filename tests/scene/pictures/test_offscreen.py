"""Processes that draw off screen: what is missing."""

import os

import pytest

from app.scene import OffscreenError, use_offscreen_rendering
from tests.python_process import run_python

pytestmark = pytest.mark.slow


def test_missing_library_is_one_line_that_names_what_to_install():
    with pytest.raises(
        OffscreenError, match=r"libnone\.so\.9: not found: install libegl1"
    ) as error:
        use_offscreen_rendering("libnone.so.9")
    assert "\n" not in str(error.value)


def test_missing_driver_is_detected_before_vtk_is_used(can_draw):
    # Without a vendor library EGL is there and has no device: VTK would end the process.
    code = (
        "from app.scene import OffscreenError, use_offscreen_rendering\n"
        "try:\n    use_offscreen_rendering()\n"
        "except OffscreenError as error:\n    print(error)\n"
    )
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}
    notified = run_python("-c", code, env=environment)
    assert notified.stdout.count("\n") == 1
    assert "install libegl1 and libgl1-mesa-dri" in notified.stdout


def test_egl_rendering_works_on_this_machine(can_draw):
    use_offscreen_rendering()
    assert os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == "vtkEGLRenderWindow"
