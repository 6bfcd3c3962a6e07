"""A tumour that the user chose among the nodes of the scene, as a surface in the tumour's frame."""

from slicer import (
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTransformNode,
)

from app.case.tumor import surface_around
from app.geometry import SurfaceMesh
from app.scene import SceneError, mesh_of_model, mesh_of_segment, points_of_markups


def surface_of(
    node: vtkMRMLNode | None, segment: str, frame: str, frame_node: vtkMRMLTransformNode
) -> SurfaceMesh:
    """The surface that ``node`` marks now, in ``frame``, which is that of ``frame_node``.

    A model is taken as it is, of a segmentation the segment called ``segment`` (empty: the only
    one), around markups a surface is made. Raises `SceneError` for no node or another kind.
    """
    if isinstance(node, vtkMRMLModelNode):
        return mesh_of_model(node, frame, frame_node)
    if isinstance(node, vtkMRMLSegmentationNode):
        return mesh_of_segment(node, segment or _only_segment(node), frame, frame_node)
    if isinstance(node, vtkMRMLMarkupsNode):
        return surface_around(points_of_markups(node, frame_node), frame)
    chosen = "no node" if node is None else f"{node.GetName()!r}, a {node.GetClassName()}, "
    raise SceneError(f"{chosen} is chosen as tumour: a model, segmentation or markups wanted")


def _only_segment(node: vtkMRMLSegmentationNode) -> str:
    segments = node.GetSegmentation()
    count = segments.GetNumberOfSegments()
    if count != 1:
        raise SceneError(f"{node.GetName()!r} has {count} segments: the name of one wanted")
    return str(segments.GetNthSegment(0).GetName())
