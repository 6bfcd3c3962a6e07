"""The surface, in the tumour's frame, of a node that the user selected as tumour."""

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
    """The present surface of ``node`` in ``frame``, the frame of ``frame_node``.

    A model is used as it is, of a segmentation the segment named ``segment`` (empty: the only
    one); around markups a surface is computed. Raises `SceneError` for no node or another kind.
    """
    if isinstance(node, vtkMRMLModelNode):
        return mesh_of_model(node, frame, frame_node)
    if isinstance(node, vtkMRMLSegmentationNode):
        return mesh_of_segment(node, segment or _only_segment(node), frame, frame_node)
    if isinstance(node, vtkMRMLMarkupsNode):
        return surface_around(points_of_markups(node, frame_node), frame)
    chosen = "no node" if node is None else f"{node.GetName()!r}, a {node.GetClassName()}"
    raise SceneError(f"tumour: {chosen} is selected; expected a model, segmentation or markups")


def _only_segment(node: vtkMRMLSegmentationNode) -> str:
    segments = node.GetSegmentation()
    count = segments.GetNumberOfSegments()
    if count != 1:
        raise SceneError(f"{node.GetName()!r} has {count} segments; expected the name of one")
    return str(segments.GetNthSegment(0).GetName())
