"""A process that loads the 3D view alone draws the same picture."""

import hashlib
import subprocess
import sys

import pytest

from app.cli.scene_process import warmup_step
from app.scene import step_png

pytestmark = pytest.mark.long

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
