"""Processes that draw off screen: what is missing, and what is loaded."""

import hashlib
import os
import subprocess
import sys

import pytest

from app.cli.scene_process import warmup_step
from app.scene import OffscreenError, step_png, use_offscreen_rendering

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
    notified = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert notified.stdout.count("\n") == 1
    assert "install libegl1 and libgl1-mesa-dri" in notified.stdout


def test_egl_rendering_works_on_this_machine(can_draw):
    use_offscreen_rendering()
    assert os.environ["VTK_DEFAULT_OPENGL_WINDOW"] == "vtkEGLRenderWindow"


DRAW_ALONE = """
import hashlib, sys
from app.cli.scene_process import warmup_step
from app.scene import load_3d_view_only, step_png
load_3d_view_only()
print(hashlib.sha256(step_png(*warmup_step(), (320, 240))).hexdigest())
print("vtk" in sys.modules, "aiohttp" in sys.modules)
"""


def test_the_picture_is_the_same_with_less_loaded(can_draw):
    command = [sys.executable, "-c", DRAW_ALONE]
    alone = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    here = hashlib.sha256(step_png(*warmup_step(), (320, 240))).hexdigest()
    assert alone == [here, "False", "False"]
    assert {"vtk", "aiohttp"} <= sys.modules.keys()
