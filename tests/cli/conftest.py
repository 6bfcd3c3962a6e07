"""Fixtures of several tests of commands."""

import pytest

from tests.bridge.live.conftest import breach as breach
from tests.bridge.live.conftest import frames_file as frames_file
from tests.bridge.live.conftest import live_yaml as live_yaml
from tests.bridge.live.conftest import start as start
from tests.ros_domain import domain_id as domain_id


@pytest.fixture
def without_scene(tmp_path_factory, monkeypatch):
    """A machine without 3D Slicer's scene: a report has no picture, which takes seconds to draw."""
    folder = tmp_path_factory.mktemp("without_scene")
    (folder / "slicer.py").write_text("raise ImportError('no slicer here')\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.syspath_prepend(folder)  # what a child process of this one imports
    return folder
