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
from app.scene.nodes.convert import poly_data, vtk_array

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
    node: vtkMRMLModelNode | None = None,
) -> vtkMRMLModelNode:
    """A visible model under ``parent``; cell colours of the surface go before ``color``.

    With ``node`` that one, which is in the scene already.
    """
    node = node or scene.AddNewNodeByClass("vtkMRMLModelNode", name)
    node.SetAndObservePolyData(surface)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetVisibility(True)
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


def show_while_known(display: vtkMRMLDisplayNode, known: bool, was_known: bool) -> None:
    """Hide what is not known, show what is known anew; what a user hid meanwhile stays hidden."""
    if not (known and was_known):
        display.SetVisibility(known)


def remove_node(scene: vtkMRMLScene, node: vtkMRMLNode) -> None:
    """Take ``node`` out of the scene, unless somebody else has done so."""
    if scene.IsNodePresent(node):
        scene.RemoveNode(node)


def remove_displayed(scene: vtkMRMLScene, node: vtkMRMLDisplayableNode) -> None:
    """Take ``node`` out of the scene, and its display nodes, which MRML would leave.

    Those that another node has stay.
    """
    ids = [node.GetNthDisplayNodeID(n) for n in range(node.GetNumberOfDisplayNodes())]
    remove_node(scene, node)
    for display in map(scene.GetNodeByID, ids):
        # Shared with another's node, or of one: a scene that was closed gives IDs a second time.
        if display is not None and display.GetDisplayableNode() is None:
            scene.RemoveNode(display)


def smooth_surface(mesh: SurfaceMesh) -> vtkPolyData:
    """The surface with normals, sharp edges kept: as a closed mesh of a scan or of CAD looks."""
    return _with_normals(poly_data(mesh))


def colored_surface(parts: list[tuple[SurfaceMesh, FloatArray]]) -> vtkPolyData:
    """Several meshes of one frame as one surface; each has one RGB(A) (0 to 1), or one a face."""
    colors = [np.atleast_2d(color) for _, color in parts]
    # Alpha for all of them or for none: what is opaque is drawn faster without it.
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
    """A sphere around the origin."""
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
