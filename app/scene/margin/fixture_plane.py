"""The constraint plane in the scene."""

from slicer import vtkMRMLMarkupsPlaneNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import Constraint
from app.geometry import Transform
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_displayed, show_while_known

_NAME = "FixturePlane"
_SIDE_MM = 30.0
_COLOR = (0.15, 0.45, 0.85)
_OPACITY = 0.25


class FixturePlane:
    """The governing half-space of a constraint, drawn as a square at the tool's point on it.

    It is in the frame of the constraint, the frame of the node ``pose``. The normal points to the
    allowed side; the square is blue on that side and grey on the other. Hidden until `show`.
    """

    def __init__(self, scene: vtkMRMLScene, batch: Batch, pose: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self._batch = batch
        self._last: Transform | None = None
        self._known = False
        self.node = scene.AddNewNodeByClass("vtkMRMLMarkupsPlaneNode", _NAME)
        self.node.SetAndObserveTransformNodeID(pose.GetID())
        self.node.SetPlaneType(vtkMRMLMarkupsPlaneNode.PlaneTypePointNormal)
        self.node.SetSizeMode(vtkMRMLMarkupsPlaneNode.SizeModeAbsolute)
        self.node.SetLocked(True)
        self.node.CreateDefaultDisplayNodes()
        display = self.node.GetDisplayNode()
        display.SetSelectedColor(*_COLOR)
        display.SetColor(*_COLOR)
        display.SetFillOpacity(_OPACITY)
        display.SetOutlineOpacity(1.0)
        display.SetHandlesInteractive(False)
        display.SetPropertiesLabelVisibility(False)
        display.SetPointLabelsVisibility(False)
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
        self.node.SetSize(_SIDE_MM, _SIDE_MM)
        self.node.EndModify(modifying)

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)
