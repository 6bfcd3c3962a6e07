"""Fixture of several tests of commands."""

import pytest


@pytest.fixture
def without_scene(tmp_path_factory, monkeypatch):
    """A machine without 3D Slicer's scene: a report has no picture, which takes seconds to draw."""
    folder = tmp_path_factory.mktemp("without_scene")
    (folder / "slicer.py").write_text("raise ImportError('no slicer here')\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return folder
