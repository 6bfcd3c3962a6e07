"""The nodes of a scene as plain values, read by MRML's own calls."""

import json
from collections.abc import Iterable
from typing import Any

from slicer import vtkMRMLScene
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import Transform, poses_in
from app.scene import MarginGuardScene


def set_poses(
    scene: MarginGuardScene, measured: Iterable[Transform], fixed: Iterable[Transform] = ()
) -> None:
    """Move the frames by edges as a tracker measures them: of any direction, along any path."""
    scene.place(poses_in(scene.reference, measured).values(), fixed)


def content(scene: vtkMRMLScene) -> dict[str, Any]:
    """Each node that is seen or moves something, by its name."""
    found = {}
    for number in range(scene.GetNumberOfNodes()):
        node = scene.GetNthNode(number)
        if node.IsA("vtkMRMLTransformableNode") or node.IsA("vtkMRMLTextNode"):
            assert node.GetName() not in found, node.GetName()
            found[node.GetName()] = json.loads(json.dumps(_values(node)))
    return found


def _values(node: Any) -> dict[str, Any]:
    values: dict[str, Any] = {"class": node.GetClassName()}
    if node.IsA("vtkMRMLTextNode"):
        return values | {"text": node.GetText()}
    parent = node.GetParentTransformNode()
    values["parent"] = None if parent is None else parent.GetName()
    if node.IsA("vtkMRMLLinearTransformNode"):
        matrix = vtkMatrix4x4()
        node.GetMatrixTransformToWorld(matrix)
        values["to_world"] = [matrix.GetElement(i, j) for i in range(4) for j in range(4)]
    if node.IsA("vtkMRMLModelNode"):
        surface = node.GetPolyData()
        values["points"] = vtk_to_numpy(surface.GetPoints().GetData()).tolist()
        values["triangles"] = vtk_to_numpy(surface.GetPolys().GetConnectivityArray()).tolist()
        colors = surface.GetCellData().GetArray("color")
        values["cell_colors"] = None if colors is None else vtk_to_numpy(colors).tolist()
    if node.IsA("vtkMRMLMarkupsNode"):
        values["points"] = [
            [*node.GetNthControlPointPositionWorld(i), node.GetNthControlPointLabel(i)]
            for i in range(node.GetNumberOfControlPoints())
        ]
    display = node.GetDisplayNode()
    if display is not None:
        values["display"] = {
            "color": display.GetColor(),
            "selected_color": display.GetSelectedColor(),
            "opacity": display.GetOpacity(),
            "visible": display.GetVisibility(),
            "scalars": [display.GetScalarVisibility(), display.GetActiveScalarName()],
        }
    return values
