"""Our values to MRML's and VTK's, and back. Millimetres and right-handed axes on both sides.

MRML holds everything in RAS axes. LPS exists only in files: Slicer converts when it reads or
writes them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from slicer import (
    vtkMRMLLinearTransformNode,
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTransformableNode,
    vtkMRMLTransformNode,
)
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkCommonTransforms import vtkGeneralTransform
from vtkmodules.vtkFiltersCore import vtkStaticCleanPolyData, vtkTriangleFilter

from app.geometry import FloatArray, SurfaceMesh, Transform
from app.scene.offscreen import SceneError


def vtk_array(values: NDArray[Any], name: str = "") -> vtkDataArray:
    """Copy ``values`` (n,) or (n, components) to a VTK array."""
    array: vtkDataArray = numpy_to_vtk(values, deep=True)
    array.SetName(name)
    return array


def numpy_array(array: vtkDataArray) -> NDArray[Any]:
    """The values of ``array``, (n,) or (n, components): a view, valid while the array exists."""
    values: NDArray[Any] = vtk_to_numpy(array)
    return values


def vtk_matrix(pose: Transform | FloatArray) -> vtkMatrix4x4:
    """The homogeneous matrix of ``pose``, a transform or (4, 4)."""
    matrix = vtkMatrix4x4()
    matrix.DeepCopy((pose.matrix if isinstance(pose, Transform) else pose).ravel().tolist())
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


def triangles_of(surface: vtkPolyData) -> tuple[FloatArray, NDArray[Any]]:
    """Vertices (n, 3) and triangles (m, 3) of the polygons and strips of ``surface``, copied."""
    split = vtkTriangleFilter()
    split.SetInputData(surface)
    split.PassVertsOff()
    split.PassLinesOff()
    split.Update()
    found = split.GetOutput()
    corners = numpy_array(found.GetPolys().GetConnectivityArray()).reshape(-1, 3).copy()
    return numpy_array(found.GetPoints().GetData()).astype(np.float64), corners


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


def mesh_of_model(
    model: vtkMRMLModelNode, frame: str, frame_node: vtkMRMLTransformNode | None
) -> SurfaceMesh:
    """The surface of ``model`` in ``frame``, the frame of ``frame_node`` (None: the world).

    Applies all parent transforms, also non-linear ones. Merges equal vertices, splits polygons into
    triangles and drops other cells. Normals stay outward under a reflection. Does not check that
    the surface is closed. Raises `SceneError` for a model without a triangle.
    """
    surface = model.GetPolyData()
    if surface is None or surface.GetNumberOfPolys() + surface.GetNumberOfStrips() == 0:
        raise SceneError(f"model {model.GetName()!r}: 0 triangles; expected a surface")
    return _mesh(surface, model, frame, frame_node)


def mesh_of_segment(
    segmentation: vtkMRMLSegmentationNode,
    segment: str,
    frame: str,
    frame_node: vtkMRMLTransformNode | None,
) -> SurfaceMesh:
    """The closed surface of the segment called ``segment``, as `mesh_of_model`.

    Creates the segmentation's closed surface if it has none. Raises `SceneError` unless one segment
    has that name, and for an empty segment.
    """
    segments = segmentation.GetSegmentation()
    ids = [segments.GetNthSegmentID(index) for index in range(segments.GetNumberOfSegments())]
    names = [segments.GetSegment(each).GetName() for each in ids]
    if names.count(segment) != 1:
        raise SceneError(
            f"segmentation {segmentation.GetName()!r}: {names.count(segment)} segments are named "
            f"{segment!r}; expected 1 among {', '.join(names) or 'none'}"
        )
    surface = vtkPolyData()
    segmentation.CreateClosedSurfaceRepresentation()
    found = segmentation.GetClosedSurfaceRepresentation(ids[names.index(segment)], surface)
    if not found or surface.GetNumberOfPolys() == 0:
        raise SceneError(
            f"segment {segment!r} of {segmentation.GetName()!r} has no surface; expected one that "
            "is not empty"
        )
    return _mesh(surface, segmentation, frame, frame_node)


def placed_points(markups: vtkMRMLMarkupsNode) -> FloatArray:
    """Copies (n, 3) of the control points in mm, without those that are still being placed."""
    placed = [
        markups.GetNthControlPointPosition(index)
        for index in range(markups.GetNumberOfControlPoints())
        if markups.GetNthControlPointPositionStatus(index) == vtkMRMLMarkupsNode.PositionDefined
    ]
    return np.array(placed, dtype=np.float64).reshape(-1, 3)


def points_of_markups(
    markups: vtkMRMLMarkupsNode, frame_node: vtkMRMLTransformNode | None
) -> FloatArray:
    """The `placed_points` (n, 3) in the frame of ``frame_node``, in mm; n may be 0.

    Applies all parent transforms.
    """
    return _moved(placed_points(markups), markups.GetParentTransformNode(), frame_node)


def _mesh(
    surface: vtkPolyData,
    node: vtkMRMLTransformableNode,
    frame: str,
    frame_node: vtkMRMLTransformNode | None,
) -> SurfaceMesh:
    clean = vtkStaticCleanPolyData()
    clean.SetInputData(surface)
    clean.Update()
    points, faces = triangles_of(clean.GetOutput())
    parent = node.GetParentTransformNode()
    moved = SurfaceMesh(frame, _moved(points, parent, frame_node), faces)
    before = SurfaceMesh(frame, points, faces).signed_volume_mm3
    if moved.signed_volume_mm3 * before < 0.0:
        return SurfaceMesh(frame, moved.vertices_mm, faces[:, ::-1])
    return moved


def _moved(
    points: FloatArray,
    parent: vtkMRMLTransformNode | None,
    frame_node: vtkMRMLTransformNode | None,
) -> FloatArray:
    """``points`` (n, 3) of a node under ``parent``, in the frame of ``frame_node``."""
    transform = vtkGeneralTransform()
    vtkMRMLTransformNode.GetTransformBetweenNodes(parent, frame_node, transform)
    source, moved = vtkPoints(), vtkPoints()
    source.SetData(vtk_array(np.ascontiguousarray(points)))
    moved.SetDataTypeToDouble()
    transform.TransformPoints(source, moved)
    return np.array(numpy_array(moved.GetData()), dtype=np.float64).reshape(-1, 3)
