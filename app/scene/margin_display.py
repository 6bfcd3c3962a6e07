"""The margin in the scene: the tumour's colour, the closest-point line, the words of the banner."""

from slicer import vtkMRMLMarkupsDisplayNode, vtkMRMLModelNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import FixtureDecision, MarginState, Proximity
from app.geometry import FloatArray
from app.scene.models import remove_displayed

_INK = (0.08, 0.12, 0.16)
_LINE_NAME = "ClosestPoints"
_STATUS_NAME = "MarginStatus"
_TEXT_SCALE = 4.2  # percent of the view's height
_POINT_MM = 0.9
_LINE_MM = 0.35

WORDS = {
    MarginState.NEGATIVE: "clear",
    MarginState.WARNING: "close to the tumour",
    MarginState.POSITIVE: "in the tumour",
    MarginState.UNKNOWN: "not to be trusted",
}


class MarginDisplay:
    """Colours ``tumor`` and keeps a line and a text node; ``tumor_pose`` is where the tumour is.

    The line runs from the tool's governing point to the tumour's nearest one and carries the
    signed distance; it is hidden while no distance is known. The text node holds the banner.
    """

    def __init__(
        self, scene: vtkMRMLScene, tumor: vtkMRMLModelNode, tumor_pose: vtkMRMLTransformNode
    ) -> None:
        self._scene = scene
        self._tumor = tumor
        self.line = scene.AddNewNodeByClass("vtkMRMLMarkupsLineNode", _LINE_NAME)
        self.line.SetAndObserveTransformNodeID(tumor_pose.GetID())
        self.line.CreateDefaultDisplayNodes()
        display = self.line.GetDisplayNode()
        display.SetSelectedColor(*_INK)
        display.SetColor(*_INK)
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(_POINT_MM)
        display.SetCurveLineSizeMode(vtkMRMLMarkupsDisplayNode.UseLineDiameter)
        display.SetLineDiameter(_LINE_MM)
        display.SetTextScale(_TEXT_SCALE)
        display.SetPropertiesLabelVisibility(False)
        display.SetPointLabelsVisibility(True)
        display.SetOccludedVisibility(True)
        display.SetOccludedOpacity(0.8)
        display.GetTextProperty().SetShadow(False)
        display.GetTextProperty().SetBold(True)
        display.GetTextProperty().SetBackgroundColor(1.0, 1.0, 1.0)
        display.GetTextProperty().SetBackgroundOpacity(0.7)
        self.status = scene.AddNewNodeByClass("vtkMRMLTextNode", _STATUS_NAME)

    def show(self, decision: FixtureDecision) -> None:
        """Show ``decision``; UNKNOWN shows grey and no distance."""
        self._tumor.GetDisplayNode().SetColor(*decision.state.color)
        proximity = decision.proximity
        if proximity is not None and (
            decision.state is MarginState.UNKNOWN or not proximity.is_finite
        ):
            proximity = None
        self._show_line(proximity)
        self.status.SetText(banner(decision.state, proximity))

    def remove(self) -> None:
        """Take the line and the text out of the scene; the tumour keeps its last colour."""
        remove_displayed(self._scene, self.line)
        self._scene.RemoveNode(self.status)

    def _show_line(self, proximity: Proximity | None) -> None:
        self.line.GetDisplayNode().SetVisibility(proximity is not None)
        if proximity is None:
            return
        modifying = self.line.StartModify()
        self.line.RemoveAllControlPoints()
        # The words stand at the outer end of the line, where they cover less of the tumour.
        self._add_point(proximity.on_tumor_mm, distance_text(proximity.signed_distance_mm))
        self._add_point(proximity.on_tool_mm, "")
        self.line.EndModify(modifying)

    def _add_point(self, point_mm: FloatArray, label: str) -> None:
        index = self.line.AddControlPoint(point_mm.tolist(), label)
        self.line.SetNthControlPointLabel(index, label)  # an empty one is replaced by a number


def banner(state: MarginState, proximity: Proximity | None) -> str:
    """The state in capitals, in words, and the signed distance in mm where it is known."""
    text = f"{state.name}: {WORDS[state]}"
    return text if proximity is None else f"{text}, {distance_text(proximity.signed_distance_mm)}"


def distance_text(signed_distance_mm: float) -> str:
    """The distance with its sign and 0.1 mm."""
    return f"{signed_distance_mm:.1f} mm"
