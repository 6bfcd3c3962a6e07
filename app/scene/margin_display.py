"""The margin in the scene: the tumour's colour, line, plane and marks, the words of the banner."""

from collections.abc import Iterable

from slicer import (
    vtkMRMLMarkupsDisplayNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.fixture import FixtureDecision, MarginState, Proximity, Reason
from app.geometry import NS_PER_S, FloatArray
from app.scene.batch import Batch
from app.scene.breach_markers import BreachMarkers
from app.scene.fixture_plane import FixturePlane
from app.scene.models import remove_displayed, remove_node

_INK = (0.08, 0.12, 0.16)
_LINE_NAME = "ClosestPoints"
_STATUS_NAME = "MarginStatus"
_TEXT_SCALE = 4.2  # percent of the view's height
_MOST_REASONS = 3
_POINT_MM = 0.9
_LINE_MM = 0.35

WORDS = {
    MarginState.NEGATIVE: "clear",
    MarginState.WARNING: "close to the tumour",
    MarginState.POSITIVE: "in the tumour",
    MarginState.UNKNOWN: "not to be trusted",
}


class MarginDisplay:
    """Colours ``tumor`` and keeps what tells of its margin; ``tumor_pose`` is where the tumour is.

    The line runs from the tool's governing point to the tumour's nearest one and carries the
    signed distance; the plane is the one that the tool may not pass. Both are hidden while they
    are not known. The text node holds the banner. Red marks stay where the tool was in the tumour.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch,
        tumor: vtkMRMLModelNode,
        tumor_pose: vtkMRMLTransformNode,
    ) -> None:
        self._scene = scene
        self._batch = batch
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

        self.plane = FixturePlane(scene, tumor_pose)
        self.breaches = BreachMarkers(scene, tumor_pose)

    def show(self, decision: FixtureDecision) -> None:
        """Show ``decision``; UNKNOWN shows grey and no distance."""
        known = decision.state is not MarginState.UNKNOWN
        proximity = decision.proximity if known else None
        if proximity is not None and not proximity.is_finite:
            proximity = None
        self._color(decision.state)
        self._show_line(proximity)
        self.plane.show(decision.constraint if decision.constraint_is_current else None)
        self._set_status(banner(decision.state, proximity, decision.reasons))
        if proximity is not None and proximity.signed_distance_mm < 0.0:
            self._batch.hold(self.breaches.node)
            self.breaches.add(proximity.on_tool_mm)

    def show_stale(self, age_ns: int | None) -> None:
        """Show grey and no distance, whatever was decided: its data are ``age_ns`` old.

        None: there were none yet. Below 0: they come from the future.
        """
        self._color(MarginState.UNKNOWN)
        self._show_line(None)
        self.plane.show(None)
        self._set_status(f"{banner(MarginState.UNKNOWN, None)}, {age_text(age_ns)}")

    def nodes(self) -> tuple[vtkMRMLNode, ...]:
        """The nodes that were added for it."""
        return (self.line, self.status, self.plane.node, self.breaches.node)

    def remove(self) -> None:
        """Take all of this out of the scene; the tumour keeps its last colour."""
        remove_displayed(self._scene, self.line)
        remove_node(self._scene, self.status)
        self.plane.remove()
        self.breaches.remove()

    def _color(self, state: MarginState) -> None:
        display = self._tumor.GetDisplayNode()
        self._batch.hold(display)
        display.SetColor(*state.color)

    def _set_status(self, text: str) -> None:
        self._batch.hold(self.status)
        self.status.SetText(text)

    def _show_line(self, proximity: Proximity | None) -> None:
        display = self.line.GetDisplayNode()
        self._batch.hold(self.line)
        self._batch.hold(display)
        display.SetVisibility(proximity is not None)
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


def banner(state: MarginState, proximity: Proximity | None, reasons: Iterable[Reason] = ()) -> str:
    """The state in capitals, in words, and the signed distance in mm where it is known.

    Of an UNKNOWN state also the faults among ``reasons``, worst first, `_MOST_REASONS` at most.
    """
    text = f"{state.name}: {WORDS[state]}"
    if state is MarginState.UNKNOWN:
        faults = [reason.value.replace("_", " ") for reason in reasons if reason.is_fault]
        return ", ".join([text, *faults[:_MOST_REASONS]])
    return text if proximity is None else f"{text}, {distance_text(proximity.signed_distance_mm)}"


def age_text(age_ns: int | None) -> str:
    """Why data of this age are not shown."""
    if age_ns is None:
        return "no data yet"
    if age_ns < 0:
        return f"data from {-age_ns / NS_PER_S:.1f} s ahead"
    return f"data {age_ns / NS_PER_S:.1f} s old"


def distance_text(signed_distance_mm: float) -> str:
    """The distance with its sign and 0.1 mm."""
    return f"{signed_distance_mm:.1f} mm"
