"""The margin in the scene: the tumour's colour, line, plane, marks of breaches and banner text."""

from dataclasses import dataclass
from itertools import product
from math import dist, floor

from slicer import (
    vtkMRMLMarkupsDisplayNode,
    vtkMRMLMarkupsNode,
    vtkMRMLMarkupsPlaneNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLTextNode,
    vtkMRMLTransformNode,
)

from app.fixture import Constraint, MarginState, Proximity
from app.geometry import FloatArray, Transform
from app.scene.models import DisplayedNode, Rgb, remove_displayed, remove_node, show_while_known
from app.scene.offscreen import SceneError
from app.scene.scene_nodes import Batch
from app.scene.shown_margin import ShownMargin, distance_text

Point = list[float]

_NEIGHBOURS = tuple(product((-1, 0, 1), repeat=3))
MIN_SPACING_MM, MAX_SPACING_MM = 0.2, 20.0
MIN_SIZE_MM, MAX_SIZE_MM = 0.2, 10.0
MAX_MARKS = 1000
"""Slicer updates all marks when the tumour moves: 1.6 ms for this many, and 35 ms to draw them."""
MAX_KEPT = 20_000
"""Points that are kept for a smaller spacing."""
MARK_COLOR = (1.0, 0.8, 1.0)
"""Nearly white with a trace of violet: it differs from the colours of all states, red included, in
luminance or in hue, also for colour-blind users (`tests/scene/test_breach_markers.py`)."""
_MARKS_NAME = "BreachMarkers"
_PLANE_NAME = "FixturePlane"
_PLANE_SIDE_MM = 30.0
_PLANE_COLOR = (0.15, 0.45, 0.85)
_PLANE_OPACITY = 0.25
_INK = (0.08, 0.12, 0.16)
_LINE_NAME = "ClosestPoints"
_STATUS_NAME = "MarginStatus"
_ACTIVATION_NAME = "CauteryState"
_TEXT_SCALE = 4.2  # percent of the view's height
_POINT_MM = 0.9
_LINE_MM = 0.35


def _markups(
    scene: vtkMRMLScene, kind: str, name: str, parent: vtkMRMLTransformNode, color: Rgb
) -> vtkMRMLMarkupsNode:
    """A new markups node of class ``kind`` under ``parent``, in ``color`` and without labels."""
    node = scene.AddNewNodeByClass(f"vtkMRMLMarkups{kind}Node", name)
    node.SetAndObserveTransformNodeID(parent.GetID())
    node.SetLocked(True)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetSelectedColor(*color)
    display.SetColor(*color)
    display.SetPropertiesLabelVisibility(False)
    display.SetPointLabelsVisibility(False)
    return node


class SpacedPoints:
    """At most ``max_count`` points in mm, at least ``spacing_mm`` apart, in their order.

    Above ``max_count`` points ``spacing_mm`` is doubled and points nearer than that to an earlier
    one are removed: each point that was ever added has one of these within twice the spacing.
    """

    def __init__(self, spacing_mm: float, max_count: int) -> None:
        self.points: list[Point] = []
        self.spacing_mm = spacing_mm
        self._max_count = max_count
        self._cells: dict[tuple[int, ...], list[Point]] = {}

    def add(self, point: Point) -> bool:
        """Add ``point`` (3,) in mm; False if another one is too near."""
        cell = [floor(value / self.spacing_mm) for value in point]
        for offset in _NEIGHBOURS:
            near = tuple(a + b for a, b in zip(cell, offset, strict=True))
            if any(dist(point, other) < self.spacing_mm for other in self._cells.get(near, ())):
                return False
        self._cells.setdefault(tuple(cell), []).append(point)
        self.points.append(point)
        while len(self.points) > self._max_count:
            self._thin()
        return True

    def _thin(self) -> None:
        points, self.points = self.points, []
        self._cells.clear()
        self.spacing_mm *= 2.0
        for point in points:
            self.add(point)


@dataclass(frozen=True, slots=True)
class MarkerStyle:
    """Style of breach markers: their least distance and their diameter in mm.

    Display only: breaches are counted without it. Raises `SceneError` outside of the limits.
    """

    spacing_mm: float = 1.0
    size_mm: float = 1.4

    def __post_init__(self) -> None:
        for name, value, least, largest in (
            ("least distance", self.spacing_mm, MIN_SPACING_MM, MAX_SPACING_MM),
            ("size", self.size_mm, MIN_SIZE_MM, MAX_SIZE_MM),
        ):
            if not least <= value <= largest:
                raise SceneError(
                    f"breach markers: {name} {value:g} mm; expected {least:g} to {largest:g} mm"
                )


class BreachMarkers(DisplayedNode):
    """A node of points in the tumour's frame, at least ``style.spacing_mm`` apart.

    The points move with the tumour and stay until `clear`. Above `MAX_MARKS` points the spacing is
    doubled and points nearer than that to an earlier one are removed: each breach still has a mark
    within twice the spacing. `MAX_KEPT` points are kept in the same way, at `MIN_SPACING_MM`, so
    that another style applies to earlier breaches, too.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        batch: Batch,
        tumor_pose: vtkMRMLTransformNode,
        style: MarkerStyle | None = None,
    ) -> None:
        super().__init__(scene, _markups(scene, "Fiducial", _MARKS_NAME, tumor_pose, MARK_COLOR))
        self._batch = batch
        self.style = style or MarkerStyle()
        """The style that is shown."""
        self._kept = SpacedPoints(MIN_SPACING_MM, MAX_KEPT)
        self._marks = SpacedPoints(self.style.spacing_mm, MAX_MARKS)
        display = self.node.GetDisplayNode()
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(self.style.size_mm)

    def __len__(self) -> int:
        return int(self.node.GetNumberOfControlPoints())

    @property
    def spacing_mm(self) -> float:
        """Least distance of two marks: that of the style, or larger for many marks."""
        return self._marks.spacing_mm

    def add(self, point_mm: FloatArray) -> bool:
        """Mark ``point_mm`` (3,) in the tumour's frame; False if another mark is too near."""
        point: Point = point_mm.tolist()
        self._kept.add(point)
        before = self._marks.spacing_mm
        if not self._marks.add(point):
            return False
        self._batch.hold(self.node)
        if self._marks.spacing_mm == before:
            self.node.AddControlPoint(point)
        else:
            self._redraw()
        return True

    def set_style(self, style: MarkerStyle) -> None:
        """Show ``style``, also for the breaches so far."""
        if style == self.style:
            return
        self.style = style
        self.node.GetDisplayNode().SetGlyphSize(style.size_mm)
        self._marks = SpacedPoints(style.spacing_mm, MAX_MARKS)
        for point in self._kept.points:
            self._marks.add(point)
        self._redraw()

    def clear(self) -> None:
        """Remove all marks; the node stays."""
        self._kept = SpacedPoints(MIN_SPACING_MM, MAX_KEPT)
        self._marks = SpacedPoints(self.style.spacing_mm, MAX_MARKS)
        self.node.RemoveAllControlPoints()

    def _redraw(self) -> None:
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for mark in self._marks.points:
            self.node.AddControlPoint(mark)
        self.node.EndModify(modifying)


class FixturePlane(DisplayedNode):
    """The governing half-space of a constraint, drawn as a square at the tool's point on it.

    It is in the frame of the constraint, the frame of the node ``pose``. The normal points to the
    allowed side; the square is blue on that side and grey on the other. Hidden until `show`.
    """

    def __init__(self, scene: vtkMRMLScene, batch: Batch, pose: vtkMRMLTransformNode) -> None:
        super().__init__(scene, _markups(scene, "Plane", _PLANE_NAME, pose, _PLANE_COLOR))
        self._batch = batch
        self._last: Transform | None = None
        self._known = False
        self.node.SetPlaneType(vtkMRMLMarkupsPlaneNode.PlaneTypePointNormal)
        self.node.SetSizeMode(vtkMRMLMarkupsPlaneNode.SizeModeAbsolute)
        display = self.node.GetDisplayNode()
        display.SetFillOpacity(_PLANE_OPACITY)
        display.SetOutlineOpacity(1.0)
        display.SetHandlesInteractive(False)
        display.SetGlyphScale(0.0)
        display.SetVisibility(False)

    def show(self, constraint: Constraint | None) -> None:
        """Draw the plane of ``constraint``; None hides it."""
        display = self.node.GetDisplayNode()
        self._batch.hold(self.node)
        self._batch.hold(display)
        known = constraint is not None
        show_while_known(display, known, self._known)
        self._known = known
        if constraint is None:
            return
        self._last = constraint.fixture_frame(self._last)
        x, y, z = self._last.rotation.T
        modifying = self.node.StartModify()
        self.node.SetAxes(x.tolist(), y.tolist(), z.tolist())
        self.node.SetCenter(self._last.translation_mm.tolist())
        self.node.SetSize(_PLANE_SIDE_MM, _PLANE_SIDE_MM)
        self.node.EndModify(modifying)


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
        self.line = _markups(scene, "Line", _LINE_NAME, tumor_pose, _INK)
        display = self.line.GetDisplayNode()
        display.SetGlyphType(vtkMRMLMarkupsDisplayNode.Sphere3D)
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(_POINT_MM)
        display.SetCurveLineSizeMode(vtkMRMLMarkupsDisplayNode.UseLineDiameter)
        display.SetLineDiameter(_LINE_MM)
        display.SetTextScale(_TEXT_SCALE)
        display.SetPointLabelsVisibility(True)
        display.SetOccludedVisibility(True)
        display.SetOccludedOpacity(0.8)
        display.GetTextProperty().SetShadow(False)
        display.GetTextProperty().SetBold(True)
        display.GetTextProperty().SetBackgroundColor(1.0, 1.0, 1.0)
        display.GetTextProperty().SetBackgroundOpacity(0.7)
        self.status = scene.AddNewNodeByClass("vtkMRMLTextNode", _STATUS_NAME)

        self.activation: vtkMRMLTextNode | None = None
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

    def add_activation(self) -> None:
        """Add the text node of the activation."""
        self.activation = self._scene.AddNewNodeByClass("vtkMRMLTextNode", _ACTIVATION_NAME)

    def nodes(self) -> tuple[vtkMRMLNode, ...]:
        """The nodes of this display, without the tumour."""
        own = (self.line, self.status, self.plane.node, self.breaches.node)
        return own if self.activation is None else (*own, self.activation)

    def remove(self) -> None:
        """Remove the nodes from the scene; the tumour keeps its last colour."""
        remove_displayed(self._scene, self.line)
        remove_node(self._scene, self.status)
        if self.activation is not None:
            remove_node(self._scene, self.activation)
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
