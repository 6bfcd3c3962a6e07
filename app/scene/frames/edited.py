"""What the user does in the scene, as our values: a transform moved by hand, a surface, points.

Everything in MRML's memory is in RAS axes: LPS exists in files alone, and Slicer turns it when it
reads or writes them.
"""

from collections.abc import Callable

import numpy as np
from slicer import (
    vtkMRMLLinearTransformNode,
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTransformableNode,
    vtkMRMLTransformNode,
)
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonMath import vtkMatrix4x4
from vtkmodules.vtkCommonTransforms import vtkGeneralTransform
from vtkmodules.vtkFiltersCore import vtkStaticCleanPolyData, vtkTriangleFilter

from app.geometry import FloatArray, MarginGuardError, SurfaceMesh, Transform
from app.scene.errors import SceneError
from app.scene.nodes.convert import numpy_array, vtk_array

OnEdit = Callable[[Transform], None]
OnRefused = Callable[[MarginGuardError], None]


class EditedTransform:
    """Calls ``on_edit`` with ``target_from_source`` when somebody else moves ``node``.

    ``target`` is the frame of the node's parent, ``source`` that of the node itself. What we move
    ourselves is announced by `expect` and not reported: so nothing that came from ROS goes back
    as an echo. A parent that moves is not reported either. A matrix that is not rigid, and a move
    under another parent than ours, whose frame has no name, go to ``on_refused``, and so does a
    `MarginGuardError` of ``on_edit``: VTK would only print an error that leaves an observer.
    """

    def __init__(
        self,
        node: vtkMRMLLinearTransformNode,
        target: str,
        source: str,
        on_edit: OnEdit,
        on_refused: OnRefused,
    ) -> None:
        self.target, self.source = target, source
        self._node = node
        self._on_edit, self._on_refused = on_edit, on_refused
        self._parent_id = node.GetTransformNodeID()
        self._known = _matrix_of(node)
        self._observer: int | None = node.AddObserver(
            vtkMRMLTransformableNode.TransformModifiedEvent, self._modified
        )

    def expect(self, target_from_source: Transform) -> None:
        """Say that we are about to put the node here, under the parent that it has now."""
        self.target = target_from_source.target
        self._parent_id = self._node.GetTransformNodeID()
        self._known = tuple(target_from_source.matrix.ravel().tolist())

    def close(self) -> None:
        """Stop watching; a second time does nothing."""
        if self._observer is not None:
            self._node.RemoveObserver(self._observer)
            self._observer = None

    def _modified(self, *_: object) -> None:
        matrix = _matrix_of(self._node)
        if matrix == self._known:
            return
        self._known = matrix
        try:
            self._on_edit(self._placed(matrix))
        except MarginGuardError as error:
            self._on_refused(error)

    def _placed(self, matrix: tuple[float, ...]) -> Transform:
        if self._node.GetTransformNodeID() != self._parent_id:
            parent = self._node.GetParentTransformNode()
            raise SceneError(
                f"{self._node.GetName()} was moved under "
                f"{'the world' if parent is None else parent.GetName()}: its pose in "
                f"{self.target!r} wanted"
            )
        return Transform.from_matrix(matrix, target=self.target, source=self.source)


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


def _matrix_of(node: vtkMRMLLinearTransformNode) -> tuple[float, ...]:
    matrix = vtkMatrix4x4()
    node.GetMatrixTransformToParent(matrix)
    return tuple(matrix.GetData())
