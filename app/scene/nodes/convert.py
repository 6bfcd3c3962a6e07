"""Our values to VTK's and back. Millimetres and right-handed axes on both sides: only the type."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode, vtkMRMLTransformNode
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import FloatArray, SurfaceMesh, Transform


def vtk_array(values: NDArray[Any], name: str = "") -> vtkDataArray:
    """Copy ``values`` (n,) or (n, components) to a VTK array."""
    array: vtkDataArray = numpy_to_vtk(values, deep=True)
    array.SetName(name)
    return array


def numpy_array(array: vtkDataArray) -> NDArray[Any]:
    """The values of ``array``, (n,) or (n, components): a view, valid while the array exists."""
    values: NDArray[Any] = vtk_to_numpy(array)
    return values


def vtk_matrix(transform: Transform) -> vtkMatrix4x4:
    """The homogeneous matrix of ``transform``."""
    matrix = vtkMatrix4x4()
    matrix.DeepCopy(transform.matrix.ravel().tolist())
    return matrix


def is_at(node: vtkMRMLLinearTransformNode, matrix: vtkMatrix4x4) -> bool:
    """True if the node's matrix to its parent equals ``matrix`` exactly."""
    present = vtkMatrix4x4()
    node.GetMatrixTransformToParent(present)
    return bool(present.GetData() == matrix.GetData())


def poly_data(mesh: SurfaceMesh) -> vtkPolyData:
    """Copy the triangles of ``mesh``."""
    points = vtkPoints()
    points.SetData(vtk_array(mesh.vertices_mm))
    offsets = np.arange(0, 3 * len(mesh.faces) + 1, 3, dtype=np.int64)
    cells = vtkCellArray()
    cells.SetData(
        vtk_array(offsets),
        vtk_array(mesh.faces.astype(np.int64).ravel()),
    )
    surface = vtkPolyData()
    surface.SetPoints(points)
    surface.SetPolys(cells)
    return surface


def world_matrix(node: vtkMRMLTransformNode | None) -> FloatArray:
    """``ras_from_node`` (4, 4) through all parents; the identity for None."""
    matrix = vtkMatrix4x4()
    if node is not None:
        node.GetMatrixTransformToWorld(matrix)
    return np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(4)])


def world_triangles(model: vtkMRMLModelNode) -> FloatArray:
    """The corners (n, 3, 3) of a model's triangles in RAS, in mm."""
    corners = numpy_array(model.GetPolyData().GetPolys().GetConnectivityArray())
    return np.asarray(world_points(model)[corners.reshape(-1, 3)])


def world_points(model: vtkMRMLModelNode) -> FloatArray:
    """The vertices (n, 3) of a model in RAS, in mm."""
    points = numpy_array(model.GetPolyData().GetPoints().GetData()).astype(np.float64)
    matrix = world_matrix(model.GetParentTransformNode())
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
