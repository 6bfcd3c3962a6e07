"""Bodies of a simulated world in the scene: models that the physics moves."""

from collections.abc import Iterable, Mapping

from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode

from app.fixture import MarginState
from app.geometry import SurfaceMesh, Transform
from app.scene.nodes.adopted_nodes import PART, mark
from app.scene.nodes.convert import is_at, vtk_matrix
from app.scene.nodes.models import add_model, remove_displayed, remove_node, smooth_surface
from app.scene.scene import MarginGuardScene

COLOR = (0.72, 0.69, 0.62)


class BodyModels:
    """A model and a transform node for each body, below the frame of ``parent`` in ``scene``.

    ``parent`` is the frame of a tracker that has the pose of the world. Not thread-safe.
    """

    def __init__(self, scene: MarginGuardScene, parent: str) -> None:
        self._scene, self._parent = scene, parent
        self._meshes: dict[str, SurfaceMesh] = {}
        self._frames: dict[str, vtkMRMLLinearTransformNode] = {}
        self.models: dict[str, vtkMRMLModelNode] = {}
        """By the name of the body."""

    @property
    def world(self) -> vtkMRMLLinearTransformNode | None:
        """The node of the frame that has the pose of the world; None while it is not known."""
        return self._scene.tree.node(self._parent)

    @property
    def meshes(self) -> Mapping[str, SurfaceMesh]:
        """Surface of each body, in its frame."""
        return self._meshes

    def show(
        self, meshes: Iterable[SurfaceMesh], poses: Mapping[str, Transform], *, is_current: bool
    ) -> None:
        """Show the surfaces in ``meshes`` at ``poses``, ``world_from_body`` by name.

        The frame of a mesh is the name of its body. A body without a pose is not shown. All are
        grey unless ``is_current``.
        """
        shown = {each.frame: each for each in meshes if each.frame in poses}
        if self.world is None:
            shown = {}
        self._use(shown)
        color = COLOR if is_current else MarginState.UNKNOWN.color
        with self._scene.batch.changes():
            for name, model in self.models.items():
                self._move(self._frames[name], poses[name])
                display = model.GetDisplayNode()
                if display.GetColor() != color:
                    display.SetColor(*color)

    def remove(self) -> None:
        """Remove all nodes."""
        self._use({})

    def _use(self, meshes: Mapping[str, SurfaceMesh]) -> None:
        gone = [name for name, mesh in self._meshes.items() if meshes.get(name) is not mesh]
        new = [name for name, mesh in meshes.items() if self._meshes.get(name) is not mesh]
        if not gone and not new:
            return
        with self._scene.batch.content():
            for name in gone:
                del self._meshes[name]
                remove_displayed(self._scene.scene, self.models.pop(name))
                remove_node(self._scene.scene, self._frames.pop(name))
            for name in new:
                self._add(meshes[name])

    def _add(self, mesh: SurfaceMesh) -> None:
        name, world = mesh.frame, self.world
        nodes = self._scene.scene
        frame = nodes.AddNewNodeByClass("vtkMRMLLinearTransformNode", f"{name}ToWorld")
        if world is not None:
            frame.SetAndObserveTransformNodeID(world.GetID())
        model = add_model(nodes, name, smooth_surface(mesh), COLOR, parent=frame)
        for node in (frame, model):
            mark(node, PART)
            node.SaveWithSceneOff()  # they are those of a running simulation
        self._meshes[name], self._frames[name], self.models[name] = mesh, frame, model

    def _move(self, node: vtkMRMLLinearTransformNode, pose: Transform) -> None:
        matrix = vtk_matrix(pose)
        if not is_at(node, matrix):
            self._scene.batch.hold(node)
            node.SetMatrixTransformToParent(matrix)
