"""A process that loads the 3D view alone."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.usefixtures("can_draw")
DRAW = """
import hashlib, sys
from app.cli.render_warmup import warmup_step
from app.scene import load_3d_view_only, step_png
if {alone}:
    load_3d_view_only()
print(hashlib.sha256(step_png(*warmup_step(), (320, 240))).hexdigest())
print("vtk" in sys.modules, "aiohttp" in sys.modules)
"""


def drawn(alone):
    command = [sys.executable, "-c", DRAW.format(alone=alone)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    digest, loaded = done.stdout.splitlines()
    return digest, loaded


def test_the_picture_is_the_same_with_less_loaded():
    digest, loaded = drawn(alone=True)
    assert loaded == "False False"
    assert drawn(alone=False) == (digest, "True True")
