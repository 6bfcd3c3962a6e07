"""Bodies of a simulated world in the scene: the physics moves them, an edit by a user is a request.

A frame has one owner. The simulation owns those of its bodies, so that an edit is not a pose but a
request to it; what the scene then shows is what the physics has made of it.
"""

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode, vtkMRMLScene

from app.fixture import MarginState
from app.geometry import NS_PER_MS, MarginGuardError, Stamp, SurfaceMesh, Transform
from app.scene.convert import is_at, vtk_matrix
from app.scene.models import add_model, remove_displayed, remove_node, smooth_surface
from app.scene.scene import MarginGuardScene
from app.scene.scene_nodes import PART, mark
from app.scene.transform_tree import RAS, TransformTree

COLOR = (0.72, 0.69, 0.62)
ANSWER_NS = 300 * NS_PER_MS
"""After an edit a body stays where the user has put it, until the physics has it there, or so."""
_SAME_MM = 0.01
Request = Callable[[list[Transform], Stamp], None]
Refused = Callable[[MarginGuardError], None]


class BodyModels:
    """A model and a transform node for each body, below the frame of ``parent`` in ``scene``.

    ``parent`` is the frame of a tracker that has the pose of the world. Not thread-safe.
    """

    def __init__(self, scene: MarginGuardScene, parent: str) -> None:
        self._scene, self._parent = scene, parent
        self.meshes: dict[str, SurfaceMesh] = {}
        """Surface of each body, in its frame."""
        self._frames: dict[str, vtkMRMLLinearTransformNode] = {}
        self.models: dict[str, vtkMRMLModelNode] = {}
        """By the name of the body."""

    @property
    def world(self) -> vtkMRMLLinearTransformNode | None:
        """The node of the frame that has the pose of the world; None while it is not known."""
        return self._scene.tree.node(self._parent)

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
        gone = [name for name, mesh in self.meshes.items() if meshes.get(name) is not mesh]
        new = [name for name, mesh in meshes.items() if self.meshes.get(name) is not mesh]
        if not gone and not new:
            return
        with self._scene.batch.content():
            for name in gone:
                del self.meshes[name]
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
        self.meshes[name], self._frames[name], self.models[name] = mesh, frame, model

    def _move(self, node: vtkMRMLLinearTransformNode, pose: Transform) -> None:
        matrix = vtk_matrix(pose)
        if not is_at(node, matrix):
            self._scene.batch.hold(node)
            node.SetMatrixTransformToParent(matrix)


class EditedWorld:
    """Transform nodes of the bodies in ``scene``, named as in ``BodyToWorld``.

    `send` calls ``request(poses, stamp)`` with the newest ``world_from_body`` of each node that a
    user has moved since the last one, and the time of the last edit on ``clock_ns``.
    ``refused(error)`` gets the error of a node that has no rigid pose in the world. All calls come
    from the scene's thread.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        world: str,
        request: Request,
        refused: Refused,
        *,
        clock_ns: Callable[[], int],
    ) -> None:
        self._world, self._request, self._refused = world, request, refused
        self._clock_ns = clock_ns
        self.tree = TransformTree(scene)
        self.tree.set(Transform.identity(RAS, world))
        self._bodies: set[str] = set()
        self._asked: dict[str, tuple[int, Transform]] = {}
        self._edits: dict[str, Transform] = {}
        self._edited_ns = 0

    @property
    def bodies(self) -> frozenset[str]:
        """Names of the bodies that have a node."""
        return frozenset(self._bodies)

    def node(self, body: str) -> vtkMRMLLinearTransformNode | None:
        """The transform node of a body; None before its first pose."""
        return self.tree.node(body) if body in self._bodies else None

    def show(self, poses: Iterable[Transform], stamp_ns: int) -> None:
        """Move the nodes to ``world_from_body`` of the physics at ``stamp_ns``.

        Bodies that have no node get one, and nodes whose body is missing in ``poses`` are removed.

        A body that a user has just moved stays until the physics has answered: until it is there,
        or for `ANSWER_NS`.
        """
        shown = {pose.source: pose for pose in poses}
        for body in self._bodies - shown.keys():
            self._bodies.discard(body)
            self._asked.pop(body, None)
            self._edits.pop(body, None)
            self.tree.remove(body)
        for pose in shown.values():
            asked = self._asked.get(pose.source)
            if asked is not None:
                asked_ns, place = asked
                is_there = float(np.abs(place.matrix - pose.matrix).max()) < _SAME_MM
                if not is_there and stamp_ns < asked_ns + ANSWER_NS:
                    continue
                del self._asked[pose.source]
            node = self.tree.set(pose)
            if pose.source not in self._bodies:
                self._bodies.add(pose.source)
                node.SaveWithSceneOff()  # the simulation has them
                self.tree.on_edit(pose.source, self._edited, self._refused)

    def send(self) -> int:
        """Request what a user has moved since the last call; return the number of bodies."""
        edits, self._edits = self._edits, {}
        if edits:
            self._request(list(edits.values()), Stamp(self._edited_ns))
        return len(edits)

    def clear(self) -> None:
        """Remove all nodes from the scene."""
        self.tree.clear()
        self._bodies.clear()
        self._asked.clear()
        self._edits.clear()

    def _edited(self, world_from_body: Transform) -> None:
        self._edited_ns = self._clock_ns()
        self._asked[world_from_body.source] = self._edited_ns, world_from_body
        self._edits[world_from_body.source] = world_from_body
