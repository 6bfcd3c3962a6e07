import os
import subprocess
import sys

import pytest

from app.scene import OffscreenError, use_offscreen_rendering


def test_missing_library_is_one_line_that_says_what_to_install() -> None:
    with pytest.raises(
        OffscreenError, match=r"libnone\.so\.9 is not there: install libegl1"
    ) as error:
        use_offscreen_rendering("libnone.so.9")
    assert "\n" not in str(error.value)


def test_no_driver_is_found_out_before_vtk_is_asked(can_draw: None) -> None:
    # Without a vendor library EGL is there and has no device: VTK would end the process.
    code = (
        "from app.scene import OffscreenError, use_offscreen_rendering\n"
        "try:\n    use_offscreen_rendering()\n"
        "except OffscreenError as error:\n    print(error)\n"
    )
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}
    told = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert told.stdout.count("\n") == 1
    assert "install libegl1 and libgl1-mesa-dri" in told.stdout


def test_this_machine_draws_by_egl(can_draw: None) -> None:
    use_offscreen_rendering()
    assert os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == "vtkEGLRenderWindow"
