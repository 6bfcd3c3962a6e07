"""Surfaces and points that stand in the scene, as our values.

Everything in MRML's memory is in RAS axes: LPS exists in files alone, and Slicer turns it when it
reads or writes them.
"""

import numpy as np
from slicer import (
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTransformableNode,
    vtkMRMLTransformNode,
)
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonTransforms import vtkGeneralTransform
from vtkmodules.vtkFiltersCore import vtkStaticCleanPolyData, vtkTriangleFilter

from app.geometry import FloatArray, SurfaceMesh
from app.scene.errors import SceneError
from app.scene.nodes.convert import numpy_array, vtk_array


def mesh_of_model(
    model: vtkMRMLModelNode, frame: str, frame_node: vtkMRMLTransformNode | None
) -> SurfaceMesh:
    """The surface of ``model`` in ``frame``, which is that of ``frame_node`` (None: the world).

    Through all parent transforms, bent ones included. Equal corners are merged and what is no
    triangle is split or dropped; a reflection on the way keeps normals outward. Whether it is
    closed is for its user to judge. Raises `SceneError` for a model without a triangle.
    """
    surface = model.GetPolyData()
    if surface is None or surface.GetNumberOfPolys() + surface.GetNumberOfStrips() == 0:
        raise SceneError(f"model {model.GetName()!r} has no triangle: a surface wanted")
    return _mesh(surface, model, frame, frame_node)


def mesh_of_segment(
    segmentation: vtkMRMLSegmentationNode,
    segment: str,
    frame: str,
    frame_node: vtkMRMLTransformNode | None,
) -> SurfaceMesh:
    """The closed surface of the segment called ``segment``, as `mesh_of_model`.

    It is made where the segmentation has none yet, and as the segmentation says. Raises
    `SceneError` for a name that no segment or several have, and for an empty one.
    """
    segments = segmentation.GetSegmentation()
    ids = [segments.GetNthSegmentID(place) for place in range(segments.GetNumberOfSegments())]
    names = [segments.GetSegment(each).GetName() for each in ids]
    if names.count(segment) != 1:
        raise SceneError(
            f"{names.count(segment)} segments of {segmentation.GetName()!r} are called "
            f"{segment!r}: 1 wanted among {', '.join(names) or 'none'}"
        )
    surface = vtkPolyData()
    segmentation.CreateClosedSurfaceRepresentation()
    found = segmentation.GetClosedSurfaceRepresentation(ids[names.index(segment)], surface)
    if not found or surface.GetNumberOfPolys() == 0:
        raise SceneError(
            f"segment {segment!r} of {segmentation.GetName()!r} has no surface: is it empty?"
        )
    return _mesh(surface, segmentation, frame, frame_node)


def points_of_markups(
    markups: vtkMRMLMarkupsNode, frame_node: vtkMRMLTransformNode | None
) -> FloatArray:
    """The control points (n, 3) that have been placed, in the frame of ``frame_node``, in mm.

    Through all parent transforms; n may be 0. Points that are still being placed are left out.
    """
    placed = [
        markups.GetNthControlPointPosition(place)
        for place in range(markups.GetNumberOfControlPoints())
        if markups.GetNthControlPointPositionStatus(place) == vtkMRMLMarkupsNode.PositionDefined
    ]
    points = np.array(placed, dtype=np.float64).reshape(-1, 3)
    return _moved(points, markups.GetParentTransformNode(), frame_node)


def _mesh(
    surface: vtkPolyData,
    node: vtkMRMLTransformableNode,
    frame: str,
    frame_node: vtkMRMLTransformNode | None,
) -> SurfaceMesh:
    clean = vtkStaticCleanPolyData()
    clean.SetInputData(surface)
    triangles = vtkTriangleFilter()
    triangles.SetInputConnection(clean.GetOutputPort())
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.Update()
    whole = triangles.GetOutput()
    points = numpy_array(whole.GetPoints().GetData()).astype(np.float64)
    faces = numpy_array(whole.GetPolys().GetConnectivityArray()).reshape(-1, 3)
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
    way = vtkGeneralTransform()
    vtkMRMLTransformNode.GetTransformBetweenNodes(parent, frame_node, way)
    source, moved = vtkPoints(), vtkPoints()
    source.SetData(vtk_array(np.ascontiguousarray(points)))
    moved.SetDataTypeToDouble()
    way.TransformPoints(source, moved)
    return np.array(numpy_array(moved.GetData()), dtype=np.float64).reshape(-1, 3)
