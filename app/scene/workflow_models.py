"""Models of guided steps: the contour that is being edited, and the tracked stylus."""

from slicer import vtkMRMLDisplayNode, vtkMRMLModelNode, vtkMRMLScene, vtkMRMLTransformNode
from vtkmodules.vtkCommonDataModel import vtkPolyData

from app.geometry import SurfaceMesh
from app.runtime import Stylus
from app.scene.convert import poly_data
from app.scene.models import add_model, remove_displayed, smooth_surface
from app.scene.scene import MarginGuardScene
from app.scene.scene_nodes import PART, mark

_CONTOUR_NAME = "Contour"
COLOR = (0.91, 0.61, 1.0)
"""The page draws the contour's points and its line in the image in the same colour."""
_OPACITY = 0.35
STYLUS_NAME = "StylusModel"
STYLUS_COLOR = (1.0, 0.55, 0.85)


class ContourModel:
    """A model node under the frame of the node ``parent``. Hidden until `show`."""

    def __init__(self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode) -> None:
        self._scene = scene
        self.node = add_model(scene, _CONTOUR_NAME, vtkPolyData(), COLOR, parent=parent)
        mark(self.node, PART)
        display = self.node.GetDisplayNode()
        display.SetRepresentation(vtkMRMLDisplayNode.WireframeRepresentation)
        display.SetOpacity(_OPACITY)
        display.SetVisibility(False)

    def show(self, mesh: SurfaceMesh) -> None:
        """Show ``mesh``, in the parent's frame."""
        self.node.SetAndObservePolyData(poly_data(mesh))
        self.node.GetDisplayNode().SetVisibility(True)

    def hide(self) -> None:
        """Hide the surface."""
        self.node.GetDisplayNode().SetVisibility(False)

    def remove(self) -> None:
        """Remove the node from the scene."""
        remove_displayed(self._scene, self.node)


class StylusModel:
    """Draws a stylus in ``scene``. It has no node before it is tracked with a calibrated tip."""

    def __init__(self, scene: MarginGuardScene) -> None:
        self.node: vtkMRMLModelNode | None = None
        self._scene = scene
        self._drawn: Stylus | None = None

    def show(self, stylus: Stylus) -> None:
        """Show ``stylus`` where its frame is in the scene; nothing without a tip."""
        edge, surface = stylus.frame_from_tip, stylus.surface
        if edge is None or surface is None or self._scene.tree.node(stylus.frame) is None:
            self.hide()
            return
        self._scene.place((), (edge,))
        pose = self._scene.tree.node(stylus.tip_frame)
        if self.node is not None and self.node.GetScene() is None:
            self.node = self._drawn = None  # the scene was closed
        if self.node is None:
            self.node = add_model(
                self._scene.scene, STYLUS_NAME, smooth_surface(surface), STYLUS_COLOR, parent=pose
            )
            mark(self.node, PART)
        elif stylus is not self._drawn:
            self.node.SetAndObservePolyData(smooth_surface(surface))
        self._drawn = stylus
        self._set_visible(True)

    def hide(self) -> None:
        """Hide the stylus: its place is not known."""
        self._set_visible(False)

    def remove(self) -> None:
        """Remove the node from the scene."""
        if self.node is not None and self.node.GetScene() is not None:
            remove_displayed(self._scene.scene, self.node)
        self.node = self._drawn = None

    def _set_visible(self, visible: bool) -> None:
        if self.node is not None and self.node.GetScene() is not None:
            display = self.node.GetDisplayNode()
            if bool(display.GetVisibility()) is not visible:
                display.SetVisibility(visible)
