"""Inputs of the panel's commands: a recorded case, a registration, the surface of a tumour."""

from dataclasses import dataclass
from pathlib import Path

from slicer import (
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTransformNode,
)

from app.case import ImageSource, open_case_images
from app.case.tumor import surface_around
from app.geometry import SurfaceMesh
from app.registration import RegistrationResult
from app.runtime import PreparedCase, prepare_case
from app.scene import SceneError, mesh_of_model, mesh_of_segment, points_of_markups
from app.session import BreachList
from app.workflow import recorded_breaches


@dataclass(frozen=True, slots=True, eq=False)
class RecordedCase:
    """``breaches`` are those of the whole recording, ``images`` None without any."""

    case: PreparedCase
    breaches: BreachList
    images: ImageSource | None = None


def prepare_recorded(folder: Path) -> RecordedCase:
    """Open and register the case and step through it; an empty recording is refused here."""
    case = prepare_case(folder)
    _ = case.extent
    return RecordedCase(case, recorded_breaches(case), open_case_images(case.case))


def registration_text(result: RegistrationResult) -> str:
    """Format method, residual and verdict with its reason in one line."""
    fre = "" if result.fre_mm is None else f", FRE {result.fre_mm:.2f} mm"
    points = f", {len(result.used)} points" if len(result.residuals_mm) else ""
    verdict = "accepted" if result.accepted else "refused"
    return f"{result.method.replace('_', ' ')}{points}{fre}: {verdict}, {result.reason}"


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
