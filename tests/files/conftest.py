"""Nodes of 3D Slicer, the second reader and writer of these files."""

from pathlib import Path

import pytest


@pytest.fixture
def slicer_node():
    """Makes a node of 3D Slicer, and its storage node for a file, by their classes."""
    slicer = pytest.importorskip("slicer")
    scene = slicer.vtkMRMLScene()
    slicer.vtkSlicerMarkupsLogic().SetMRMLScene(scene)

    def made(kind: str, storage_kind: str, path: Path):
        node = scene.AddNewNodeByClass(kind)
        storage = getattr(slicer, storage_kind)()
        scene.AddNode(storage)
        storage.SetFileName(str(path))
        return node, storage

    return made
