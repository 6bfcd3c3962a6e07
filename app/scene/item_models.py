"""Models of the display items of a session."""

from collections.abc import Iterator

from slicer import vtkMRMLModelNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import MarginState
from app.runtime import ShownItem
from app.scene.models import Rgb, add_model, remove_displayed, smooth_surface
from app.scene.scene_nodes import Batch


class ItemModels:
    """Draws display items in ``scene``, each under the frame of its tip.

    While its pose may not be used, a rod is grey and a pointer is hidden.
    """

    def __init__(self, scene: vtkMRMLScene, batch: Batch, *, is_live: bool) -> None:
        self.nodes: dict[str, vtkMRMLModelNode] = {}
        """The models by the names of their items."""
        self._scene = scene
        self._batch = batch
        self._is_live = is_live
        self._drawn: dict[str, ShownItem] = {}
        self._known: dict[str, bool] = {}

    def shows(self, item: ShownItem) -> bool:
        """True if the surface of ``item`` is the one that is drawn."""
        return item.name in self._drawn and self._drawn[item.name].surface is item.surface

    def draw(self, item: ShownItem, parent: vtkMRMLTransformNode | None) -> None:
        """Add ``item``, or replace its surface; nothing without a tip."""
        if item.surface is None:
            return
        node, surface = self.nodes.get(item.name), smooth_surface(item.surface)
        if node is None:
            is_grey = self._is_live and not item.is_pointer  # until the first decision
            color = MarginState.UNKNOWN.color if is_grey else item.declared.color
            name = item.declared.model_name
            self.nodes[item.name] = add_model(self._scene, name, surface, color, parent=parent)
        else:
            self._batch.hold(node)
            node.SetAndObservePolyData(surface)
        self._drawn[item.name] = item

    def set_known(self, item: ShownItem, known: bool) -> None:
        """State whether the pose of ``item`` may be used."""
        self._known[item.name] = known
        if item.is_pointer and item.name in self.nodes:
            display = self.nodes[item.name].GetDisplayNode()
            if bool(display.GetVisibility()) is not known:
                display.SetVisibility(known)

    def rods(self) -> Iterator[tuple[vtkMRMLModelNode, Rgb, bool]]:
        """The model of each rod, its colour, and whether its pose may be used."""
        for name, item in self._drawn.items():
            if not item.is_pointer:
                yield self.nodes[name], item.declared.color, self._known.get(name, True)

    def remove(self) -> None:
        """Remove all models from the scene."""
        for node in self.nodes.values():
            remove_displayed(self._scene, node)
        self.nodes.clear()
        self._drawn.clear()
