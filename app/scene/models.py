"""Surfaces as model nodes."""

import numpy as np
from slicer import (
    vtkMRMLDisplayableNode,
    vtkMRMLDisplayNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkFiltersCore import (
    vtkAppendPolyData,
    vtkPolyDataNormals,
    vtkStaticCleanPolyData,
)
from vtkmodules.vtkFiltersSources import vtkSphereSource

from app.geometry import FloatArray, SurfaceMesh
from app.scene.convert import poly_data, vtk_array

Rgb = tuple[float, float, float]

_FEATURE_DEGREES = 35.0
"""Edges with a larger angle between their faces are drawn sharp, others smooth."""
_COLOR_ARRAY = "color"


def add_model(
    scene: vtkMRMLScene,
    name: str,
    surface: vtkPolyData,
    color: Rgb,
    *,
    opacity: float = 1.0,
    parent: vtkMRMLTransformNode | None = None,
    node: vtkMRMLModelNode | None = None,
) -> vtkMRMLModelNode:
    """Add a visible model under ``parent``; cell colours of ``surface`` override ``color``.

    ``node``: use this node of the scene instead of a new one.
    """
    node = node or scene.AddNewNodeByClass("vtkMRMLModelNode", name)
    node.SetAndObservePolyData(surface)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetVisibility(True)
    display.SetColor(*color)
    display.SetOpacity(opacity)
    # Ambient light, because a single headlight leaves the sides black and hides the state's colour.
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


def show_while_known(display: vtkMRMLDisplayNode, known: bool, was_known: bool) -> None:
    """Hide what becomes unknown, show what becomes known; keep what a user has hidden meanwhile."""
    if not (known and was_known):
        display.SetVisibility(known)


def remove_node(scene: vtkMRMLScene, node: vtkMRMLNode) -> None:
    """Remove ``node`` from the scene if it is still in it."""
    if scene.IsNodePresent(node):
        scene.RemoveNode(node)


def remove_displayed(scene: vtkMRMLScene, node: vtkMRMLDisplayableNode) -> None:
    """Remove ``node`` and its display nodes, which MRML would leave in the scene.

    Display nodes that another node uses stay.
    """
    ids = [node.GetNthDisplayNodeID(n) for n in range(node.GetNumberOfDisplayNodes())]
    remove_node(scene, node)
    for display in map(scene.GetNodeByID, ids):
        # Another node may use it, or own it: after a scene was closed, IDs are given again.
        if display is not None and display.GetDisplayableNode() is None:
            scene.RemoveNode(display)


class DisplayedNode:
    """Owner of ``node``, which is in ``scene``."""

    def __init__(self, scene: vtkMRMLScene, node: vtkMRMLDisplayableNode) -> None:
        self._scene, self.node = scene, node

    def hide(self) -> None:
        """Hide the node."""
        self.node.GetDisplayNode().SetVisibility(False)

    def remove(self) -> None:
        """Remove the node and its display nodes from the scene."""
        remove_displayed(self._scene, self.node)


def smooth_surface(mesh: SurfaceMesh) -> vtkPolyData:
    """The surface of ``mesh`` with normals; sharp edges stay sharp."""
    return _with_normals(poly_data(mesh))


def colored_surface(parts: list[tuple[SurfaceMesh, FloatArray]]) -> vtkPolyData:
    """Join meshes of one frame to one surface; each has one RGB(A) (0 to 1), or one per face."""
    colors = [np.atleast_2d(color) for _, color in parts]
    # Alpha for all or for none: opaque surfaces are drawn faster without it.
    channels = 4 if any(rows.shape[1] == 4 and (rows[:, 3] < 1.0).any() for rows in colors) else 3
    append = vtkAppendPolyData()
    for (mesh, _), rows in zip(parts, colors, strict=True):
        levels = np.full((len(mesh.faces), channels), 255, dtype=np.uint8)
        given = rows[:, :channels]
        levels[:, : given.shape[1]] = np.round(255.0 * given)
        surface = poly_data(mesh)
        surface.GetCellData().AddArray(vtk_array(levels, _COLOR_ARRAY))
        append.AddInputData(surface)
    append.Update()
    return _with_normals(append.GetOutput())


def ball(radius_mm: float) -> vtkPolyData:
    """A sphere around the origin, as a surface."""
    sphere = vtkSphereSource()
    sphere.SetRadius(radius_mm)
    sphere.SetThetaResolution(32)
    sphere.SetPhiResolution(32)
    sphere.Update()
    surface: vtkPolyData = sphere.GetOutput()
    return surface


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
