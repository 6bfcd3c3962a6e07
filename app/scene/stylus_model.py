"""The stylus in the scene: a rod with its point at the calibrated tip, while it is tracked."""

from slicer import vtkMRMLModelNode

from app.runtime import Stylus
from app.scene.nodes.adopted_nodes import PART, mark
from app.scene.nodes.models import add_model, remove_displayed, smooth_surface
from app.scene.scene import MarginGuardScene

NAME = "StylusModel"
COLOR = (1.0, 0.55, 0.85)


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
                self._scene.scene, NAME, smooth_surface(surface), COLOR, parent=pose
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
