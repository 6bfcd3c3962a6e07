"""The margin in the scene: the tumour's colour, line, plane, breach marks and banner text."""

from slicer import (
    vtkMRMLMarkupsDisplayNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTextNode,
    vtkMRMLTransformNode,
)

from app.fixture import MarginState, Proximity
from app.geometry import FloatArray
from app.scene.margin.breach_markers import BreachMarkers
from app.scene.margin.fixture_plane import FixturePlane
from app.scene.margin.shown_margin import ShownMargin, distance_text
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_displayed, remove_node, show_while_known

_INK = (0.08, 0.12, 0.16)
_LINE_NAME = "ClosestPoints"
_STATUS_NAME = "MarginStatus"
_CAUTERY_NAME = "CauteryState"
_TEXT_SCALE = 4.2  # percent of the view's height
_POINT_MM = 0.9
_LINE_MM = 0.35


class MarginDisplay:
    """Colours ``tumor`` and owns the nodes that show its margin.

    ``tumor_pose`` is the node of the tumour's ``frame``, in which everything is drawn. The line
    runs from the tumour's to the tool's closest point, with the signed distance as its label; the
    plane is that of the constraint. Both are hidden while they are unknown. The text node holds the
    banner. Marks show where the tool was inside the tumour. ``state`` is the state shown now.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch,
        tumor: vtkMRMLModelNode,
        tumor_pose: vtkMRMLTransformNode,
        frame: str,
    ) -> None:
        self.frame = frame
        self._scene = scene
        self._batch = batch
        self._tumor = tumor
        self.state = MarginState.UNKNOWN
        self._drawn: Proximity | None = None
        self._line_known = False
        self.line = scene.AddNewNodeByClass("vtkMRMLMarkupsLineNode", _LINE_NAME)
        self.line.SetAndObserveTransformNodeID(tumor_pose.GetID())
        self.line.SetLocked(True)
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

        self.cautery: vtkMRMLTextNode | None = None
        self.plane = FixturePlane(scene, batch, tumor_pose)
        self.breaches = BreachMarkers(scene, batch, tumor_pose)

    def show(self, shown: ShownMargin) -> None:
        """Show ``shown``, and mark where the tool is inside the tumour."""
        self.state = shown.state
        display = self._tumor.GetDisplayNode()
        self._batch.hold(display)
        display.SetColor(*shown.state.color)
        display.SetScalarVisibility(False)  # point colours would hide the state's colour
        self._batch.hold(self.status)
        self.status.SetText(shown.text)
        self._show_line(shown.proximity)
        self.plane.show(shown.constraint)
        if shown.proximity is not None and shown.proximity.signed_distance_mm < 0.0:
            self.breaches.add(shown.proximity.on_tool_mm)

    def add_cautery(self) -> None:
        """Add the text node of the cautery's state."""
        self.cautery = self._scene.AddNewNodeByClass("vtkMRMLTextNode", _CAUTERY_NAME)

    def nodes(self) -> tuple[vtkMRMLNode, ...]:
        """The nodes of this display, without the tumour."""
        own = (self.line, self.status, self.plane.node, self.breaches.node)
        return own if self.cautery is None else (*own, self.cautery)

    def remove(self) -> None:
        """Remove the nodes from the scene; the tumour keeps its last colour."""
        remove_displayed(self._scene, self.line)
        remove_node(self._scene, self.status)
        if self.cautery is not None:
            remove_node(self._scene, self.cautery)
        self.plane.remove()
        self.breaches.remove()

    def _show_line(self, proximity: Proximity | None) -> None:
        display = self.line.GetDisplayNode()
        self._batch.hold(self.line)
        self._batch.hold(display)
        known = proximity is not None
        show_while_known(display, known, self._line_known)
        self._line_known = known
        if proximity is None or proximity is self._drawn:
            return
        self._drawn = proximity
        modifying = self.line.StartModify()
        self.line.RemoveAllControlPoints()
        # The label is at the outer end of the line, where it covers less of the tumour.
        label = distance_text(proximity.signed_distance_mm)
        is_inside = proximity.signed_distance_mm < 0.0
        self._add_point(proximity.on_tumor_mm, label if is_inside else "")
        self._add_point(proximity.on_tool_mm, "" if is_inside else label)
        self.line.EndModify(modifying)

    def _add_point(self, point_mm: FloatArray, label: str) -> None:
        index = self.line.AddControlPoint(point_mm.tolist(), label)
        self.line.SetNthControlPointLabel(index, label)  # AddControlPoint replaces an empty label
