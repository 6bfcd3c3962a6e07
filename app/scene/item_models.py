"""Models of display items, of structures and other tools, and of a contour that is being edited."""

from collections.abc import Iterator, Mapping

from slicer import vtkMRMLDisplayNode, vtkMRMLModelNode, vtkMRMLScene, vtkMRMLTransformNode
from vtkmodules.vtkCommonDataModel import vtkPolyData

from app.fixture import MarginState
from app.geometry import SurfaceMesh
from app.runtime import ShownItem, StructureContent, ToolContent
from app.scene.convert import poly_data
from app.scene.models import DisplayedNode, Rgb, add_model, remove_displayed, smooth_surface
from app.scene.scene_nodes import PART, Batch, mark
from app.session import Role


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


_OPACITY = {Role.TARGET: 0.4, Role.FORBIDDEN: 0.25}


class StructureModels:
    """Draws structures and tools in ``scene``, each by its name, in the frame of its shape."""

    def __init__(self, scene: vtkMRMLScene, batch: Batch) -> None:
        self.nodes: dict[str, vtkMRMLModelNode] = {}
        """The models by the frames of their shapes."""
        self._scene, self._batch = scene, batch

    def add(self, structure: StructureContent | ToolContent, parent: vtkMRMLTransformNode) -> None:
        """Add ``structure`` under its frame, in grey until its first state."""
        opacity = 1.0 if isinstance(structure, ToolContent) else _OPACITY[structure.role]
        self.nodes[structure.surface.frame] = add_model(
            self._scene,
            structure.name,
            smooth_surface(structure.surface),
            MarginState.UNKNOWN.color,
            opacity=opacity,
            parent=parent,
        )

    def show(self, states: Mapping[str, MarginState]) -> None:
        """Colour each structure by its state; one without a state is grey."""
        for name, node in self.nodes.items():
            color = states.get(name, MarginState.UNKNOWN).color
            display = node.GetDisplayNode()
            if display.GetColor() != color:
                self._batch.hold(display)
                display.SetColor(*color)

    def remove(self) -> None:
        """Remove all models from the scene."""
        for node in self.nodes.values():
            remove_displayed(self._scene, node)
        self.nodes.clear()


_CONTOUR_NAME = "Contour"
CONTOUR_COLOR = (0.91, 0.61, 1.0)
"""The page draws the contour's points and its line in the image in the same colour."""
_CONTOUR_OPACITY = 0.35


class ContourModel(DisplayedNode):
    """A model node under the frame of the node ``parent``. Hidden until `show`."""

    def __init__(self, scene: vtkMRMLScene, parent: vtkMRMLTransformNode) -> None:
        self._shown: SurfaceMesh | None = None
        node = add_model(scene, _CONTOUR_NAME, vtkPolyData(), CONTOUR_COLOR, parent=parent)
        super().__init__(scene, node)
        mark(self.node, PART)
        display = self.node.GetDisplayNode()
        display.SetRepresentation(vtkMRMLDisplayNode.WireframeRepresentation)
        display.SetOpacity(_CONTOUR_OPACITY)
        display.SetVisibility(False)

    def show(self, mesh: SurfaceMesh | None) -> None:
        """Show ``mesh``, in the parent's frame; None hides the node."""
        if mesh is not self._shown:
            self._shown = mesh
            if mesh is not None:
                self.node.SetAndObservePolyData(poly_data(mesh))
            self.node.GetDisplayNode().SetVisibility(mesh is not None)
