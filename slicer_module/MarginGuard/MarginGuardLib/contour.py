"""Contour of a tumour in the panel: points of Slicer's markups or at the tip, surface, acceptance.

Surface, uncertainty and checks are those of the page (`app.contour`).
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLMarkupsFiducialNode,
    vtkMRMLScene,
    vtkMRMLTransformNode,
)

from app.contour import MAX_POINTS, Contour, ContourPoint, ContourSurface
from app.contour.surface import pixel_sigma
from app.geometry import FloatArray, InputError
from app.runtime import GUARDED_TOOL, Operator, tip_mm
from app.scene import ContourModel, SceneError
from app.scene.convert import placed_points
from app.scene.item_models import CONTOUR_COLOR
from app.workflow import ContourTumor

from .shown_session import ShownSession

NAME = "TumorContour"
_MAX_UNDO = 200
_EDITS = (
    vtkMRMLMarkupsFiducialNode.PointPositionDefinedEvent,
    vtkMRMLMarkupsFiducialNode.PointRemovedEvent,
    vtkMRMLMarkupsFiducialNode.PointEndInteractionEvent,
)


class ContourPoints:
    """A list of points whose coordinates are in the frame of its parent node.

    Slicer's own tools place, drag and delete them. ``edited()`` is called after each such edit.
    """

    def __init__(
        self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode, edited: Callable[[], None]
    ) -> None:
        self._scene = scene
        self._edited = edited
        self._writing = False
        self.node = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", NAME)
        self.node.CreateDefaultDisplayNodes()
        self.node.GetDisplayNode().SetPointLabelsVisibility(False)
        self.node.GetDisplayNode().SetSelectedColor(*CONTOUR_COLOR)
        self.node.SetAndObserveTransformNodeID(parent.GetID())
        self._history: deque[FloatArray] = deque(maxlen=_MAX_UNDO)
        self._last = self.positions_mm
        self._tags = [self.node.AddObserver(event, self._on_edit) for event in _EDITS]

    @property
    def is_in_scene(self) -> bool:
        """False after a user has deleted the node."""
        return self.node.GetScene() is not None

    @property
    def positions_mm(self) -> FloatArray:
        """Copies (n, 3) of the placed points in mm; one that is being placed is not among them."""
        return placed_points(self.node)

    @property
    def can_undo(self) -> bool:
        """True if there is an edit to undo."""
        return bool(self._history)

    def follow(self, parent: vtkMRMLTransformNode) -> None:
        """Keep the points under ``parent``, also after the display was made anew."""
        if self.node.GetParentTransformNode() is not parent:
            self.node.SetAndObserveTransformNodeID(parent.GetID())

    def replace(self, positions_mm: FloatArray) -> None:
        """Use these points (n, 3); `undo` restores those before. Raises `InputError` above 300."""
        if len(positions_mm) > MAX_POINTS:
            raise InputError(f"contour: {len(positions_mm)} points; expected at most {MAX_POINTS}")
        self._write(positions_mm)
        self._record()

    def undo(self) -> None:
        """Restore the points before the last edit."""
        if not self._history:
            raise InputError("contour: there is no change to undo; expected one")
        self._write(self._history.pop())
        self._last = self.positions_mm

    def remove(self) -> None:
        """Remove the node from the scene."""
        for tag in self._tags:
            self.node.RemoveObserver(tag)
        if self.is_in_scene:
            self._scene.RemoveNode(self.node)

    def _write(self, positions_mm: FloatArray) -> None:
        self._writing = True
        modifying = self.node.StartModify()
        self.node.RemoveAllControlPoints()
        for point in positions_mm.tolist():
            self.node.AddControlPoint(point)
        self.node.EndModify(modifying)
        self._writing = False

    def _record(self) -> None:
        positions_mm = self.positions_mm
        if not np.array_equal(positions_mm, self._last):
            self._history.append(self._last)
            self._last = positions_mm

    def _on_edit(self, *_: object) -> None:
        if not self._writing:
            self._record()
            self._edited()


@dataclass(frozen=True, slots=True)
class ContourShown:
    """A contour as the panel shows it. ``can_use``: its surface and uncertainty are known."""

    text: str = ""
    can_edit: bool = False
    has_points: bool = False
    can_undo: bool = False
    can_use: bool = False


class PanelContour:
    """The contour of the shown session. Call it in the scene's thread.

    ``logic`` is the application's, whose mouse mode places points. ``changed()`` is called in any
    thread when there is something to show.
    """

    def __init__(
        self,
        session: ShownSession,
        mrml_scene: vtkMRMLScene,
        logic: vtkMRMLApplicationLogic | None,
        changed: Callable[[], None],
    ) -> None:
        self._session = session
        self._mrml_scene = mrml_scene
        self._logic = logic
        self._changed = changed
        self._points: ContourPoints | None = None
        self._model: ContourModel | None = None
        self._tumor = ContourTumor(session.display_operator.compute, changed)
        self._settings = Contour("")
        self._pixel_sigma_mm = 0.0

    def note_pixel(self, pixel_mm: tuple[float, float] | None) -> None:
        """Points may be placed on an image with pixels of this size; None: no image is shown."""
        if pixel_mm is not None:
            self._pixel_sigma_mm = max(self._pixel_sigma_mm, pixel_sigma(pixel_mm))

    def place(self) -> None:
        """Let clicks in Slicer's views add points, until the mouse mode is changed."""
        if self._logic is None:
            raise InputError("contour: there is no view to click in; expected one")
        points, selection = self._edited(), self._logic.GetSelectionNode()
        interaction = self._logic.GetInteractionNode()
        selection.SetReferenceActivePlaceNodeClassName(points.node.GetClassName())
        selection.SetReferenceActivePlaceNodeID(points.node.GetID())
        interaction.SetPlaceModePersistence(1)
        interaction.SetCurrentInteractionMode(interaction.Place)

    def add_tip(self, tool: str = GUARDED_TOOL) -> None:
        """Add a point at the tip of ``tool``."""
        tip_mm = self._tip_mm(tool)
        points = self._edited()
        points.replace(np.vstack([points.positions_mm, tip_mm]))

    def erase_at_tip(self, radius_mm: float) -> None:
        """Remove the points within ``radius_mm`` of the tool's tip."""
        points, tip_mm = self._edited(), self._tip_mm()
        points.replace(_contour("", points.positions_mm).erased(tip_mm, radius_mm).positions_mm)

    def delete_all(self) -> None:
        """Remove all points; `undo` restores them."""
        self._edited().replace(np.empty((0, 3)))

    def undo(self) -> None:
        """Restore the points before the last edit."""
        self._edited().undo()

    def set_options(self, dilation_mm: float, error_mm: float, hydromark_mm: float) -> None:
        """Set the dilation, the standard deviation of a point and the radius of a hydromark.

        0 for the second: it is not stated; for the third: the points are on the tumour's surface.
        """
        self._settings = Contour("", (), dilation_mm, error_mm or None, hydromark_mm)

    def use(self) -> None:
        """Use the contour as the tumour of the session, which is then on hold."""
        edge = self._session.started().content.frame_from_tumor
        self._tumor.use(self._contour(edge.target), edge, self._session.display_operator)

    def update(self, operator: Operator | None) -> None:
        """Keep points and surface in the frame that the tumour moves with; compute the surface."""
        if self._points is not None and not self._points.is_in_scene:
            self._forget()
        if self._points is None or operator is None or self._session.display is None:
            return
        frame = operator.content.frame_from_tumor.target
        try:
            self._points.follow(self._session.display.frame_node(frame))
        except SceneError:
            return  # the next step places the frame
        self._tumor.follow(self._contour(frame), lambda _: self._pixel_sigma_mm)
        self._draw(self._tumor.surface)

    def shown(self) -> ContourShown:
        """The state of the contour for the panel."""
        can_edit = self._session.is_running and self._session.display is not None
        if self._points is None:
            return ContourShown(can_edit=can_edit)
        count, surface = len(self._points.positions_mm), self._tumor.surface
        size, sigma, problem = self._tumor.texts()
        sigma = f"\N{GREEK SMALL LETTER SIGMA} {sigma}" if sigma else ""
        lines = [f"{count} point{'s' * (count != 1)}", size, sigma, problem]
        return ContourShown(
            text="\n".join(each for each in lines if each),
            can_edit=can_edit,
            has_points=count > 0,
            can_undo=self._points.can_undo,
            can_use=can_edit and surface is not None and surface.uncertainty is not None,
        )

    def clear(self) -> None:
        """Remove points and surface from the scene, as at the end of a session."""
        if self._points is not None:
            self._points.remove()
        self._forget()

    def close(self) -> None:
        """End the thread."""
        self.clear()
        self._tumor.close()

    def _edited(self) -> ContourPoints:
        """The points, which are added to the scene before their first edit."""
        if self._points is None or not self._points.is_in_scene:
            frame = self._session.started().content.frame_from_tumor.target
            parent = self._session.shown().frame_node(frame)
            self._points = ContourPoints(self._mrml_scene, parent, self._changed)
        return self._points

    def _tip_mm(self, tool: str = GUARDED_TOOL) -> FloatArray:
        session, content = self._session, self._session.started().content
        step, state = session.shown_step, session.readout()[0]
        is_aged = step is not None and state is not step.decision.state
        frame = content.frame_from_tumor.target
        return tip_mm(None if is_aged else step, content, tool, frame)

    def _contour(self, frame: str) -> Contour:
        positions_mm = np.empty((0, 3)) if self._points is None else self._points.positions_mm
        return replace(self._settings, frame=frame, points=_contour(frame, positions_mm).points)

    def _draw(self, surface: ContourSurface | None) -> None:
        parent = self._points.node.GetParentTransformNode()
        if self._model is not None and self._model.node.GetScene() is None:
            self._model = None
        if self._model is None and surface is not None:
            self._model = ContourModel(self._mrml_scene, parent)
        if self._model is None:
            return
        if self._model.node.GetParentTransformNode() is not parent:
            self._model.node.SetAndObserveTransformNodeID(parent.GetID())
        self._model.show(None if surface is None else surface.mesh)

    def _forget(self) -> None:
        if self._model is not None and self._model.node.GetScene() is not None:
            self._model.remove()
        self._points = self._model = None
        self._tumor.forget()
        self._pixel_sigma_mm = 0.0


def _contour(frame: str, positions_mm: FloatArray) -> Contour:
    points = (ContourPoint(number, each) for number, each in enumerate(positions_mm, 1))
    return Contour(frame, tuple(points))
