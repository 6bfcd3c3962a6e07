"""Surfaces as model nodes."""

import numpy as np
from slicer import (
    vtkMRMLDisplayableNode,
    vtkMRMLDisplayNode,
    vtkMRMLModelNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersCore import (
    vtkAppendPolyData,
    vtkPolyDataNormals,
    vtkStaticCleanPolyData,
)

from app.geometry import FloatArray, SurfaceMesh
from app.scene.convert import poly_data, vtk_array

Rgb = tuple[float, float, float]

_FEATURE_DEGREES = 35.0
"""Edges sharper than this look like edges; flatter ones are shaded smooth."""
_COLOR_ARRAY = "color"


def add_model(
    scene: vtkMRMLScene,
    name: str,
    surface: vtkPolyData,
    color: Rgb,
    *,
    opacity: float = 1.0,
    parent: vtkMRMLTransformNode | None = None,
) -> vtkMRMLModelNode:
    """A visible model under ``parent``; cell colours of the surface go before ``color``."""
    node = scene.AddNewNodeByClass("vtkMRMLModelNode", name)
    node.SetAndObservePolyData(surface)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetColor(*color)
    display.SetOpacity(opacity)
    # Some light of its own: a lone headlight leaves the sides black, and a state must show there.
    display.SetAmbient(0.3)
    display.SetDiffuse(0.75)
    display.SetSpecular(0.15)
    display.SetPower(20.0)
    display.SetVisibility2D(False)
    if surface.GetCellData().HasArray(_COLOR_ARRAY):
        display.SetActiveScalar(_COLOR_ARRAY, 1)  # 1: of the cells
        display.SetScalarRangeFlag(vtkMRMLDisplayNode.UseDirectMapping)
        display.SetScalarVisibility(True)
    if parent is not None:
        node.SetAndObserveTransformNodeID(parent.GetID())
    return node


def remove_displayed(scene: vtkMRMLScene, node: vtkMRMLDisplayableNode) -> None:
    """Take ``node`` out of the scene together with its display nodes, which MRML would leave."""
    displays = [node.GetNthDisplayNode(n) for n in range(node.GetNumberOfDisplayNodes())]
    scene.RemoveNode(node)
    for display in displays:
        scene.RemoveNode(display)


def smooth_surface(mesh: SurfaceMesh) -> vtkPolyData:
    """The surface with normals, sharp edges kept: as a closed mesh of a scan or of CAD looks."""
    return _with_normals(poly_data(mesh))


def colored_surface(parts: list[tuple[SurfaceMesh, FloatArray]]) -> vtkPolyData:
    """Several meshes of one frame as one surface; each has one RGB(A) (0 to 1), or one a face."""
    append = vtkAppendPolyData()
    for mesh, color in parts:
        surface = poly_data(mesh)
        levels = np.round(255.0 * np.atleast_2d(color)[:, :3]).astype(np.uint8)
        levels = np.ascontiguousarray(np.broadcast_to(levels, (len(mesh.faces), 3)))
        surface.GetCellData().AddArray(vtk_array(levels, _COLOR_ARRAY))
        append.AddInputData(surface)
    append.Update()
    return _with_normals(append.GetOutput())


def _with_normals(surface: vtkPolyData) -> vtkPolyData:
    # vtkCleanPolyData does the same and loses 4 bytes a face at each run (VTK 9.6).
    clean = vtkStaticCleanPolyData()
    clean.SetInputData(surface)
    normals = vtkPolyDataNormals()
    normals.SetInputConnection(clean.GetOutputPort())
    normals.SetFeatureAngle(_FEATURE_DEGREES)
    normals.Update()
    result: vtkPolyData = normals.GetOutput()
    return result
