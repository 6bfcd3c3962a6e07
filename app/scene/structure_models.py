"""Models of the structures beside the tumour and of other tools, in the colours of their states."""

from collections.abc import Mapping

from slicer import vtkMRMLModelNode, vtkMRMLScene, vtkMRMLTransformNode

from app.fixture import MarginState
from app.runtime import StructureContent, ToolContent
from app.scene.models import add_model, remove_displayed, smooth_surface
from app.scene.scene_nodes import Batch
from app.session import Role

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
