"""Surface of the tumour from a node that the user selected, in the tumour's frame."""

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
    """Return the present surface of ``node`` in ``frame``, whose node is ``frame_node``.

    For a model its surface, for a segmentation the surface of the segment named ``segment`` (empty:
    the only one), for markups a surface around the points. Raises `SceneError` for None or another
    class of node.
    """
    if isinstance(node, vtkMRMLModelNode):
        return mesh_of_model(node, frame, frame_node)
    if isinstance(node, vtkMRMLSegmentationNode):
        return mesh_of_segment(node, segment or _only_segment(node), frame, frame_node)
    if isinstance(node, vtkMRMLMarkupsNode):
        return surface_around(points_of_markups(node, frame_node), frame)
    chosen = "no node" if node is None else f"{node.GetName()!r} ({node.GetClassName()})"
    raise SceneError(f"tumour: {chosen} is selected; expected a model, segmentation or markups")


def _only_segment(node: vtkMRMLSegmentationNode) -> str:
    segments = node.GetSegmentation()
    count = segments.GetNumberOfSegments()
    if count != 1:
        raise SceneError(
            f"{node.GetName()!r} has {count} segments and none is named; expected the name of one"
        )
    return str(segments.GetNthSegment(0).GetName())
