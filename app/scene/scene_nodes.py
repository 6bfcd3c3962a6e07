"""Our nodes in a scene that users and files change too: batches, marks, reuse and repair."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from slicer import (
    vtkMRMLApplicationLogic,
    vtkMRMLDisplayableNode,
    vtkMRMLLinearTransformNode,
    vtkMRMLMarkupsNode,
    vtkMRMLModelNode,
    vtkMRMLNode,
    vtkMRMLScene,
    vtkMRMLSequenceBrowserNode,
    vtkMRMLTransformableNode,
)
from vtkmodules.vtkCommonCore import vtkPoints

from app.scene.models import remove_displayed, remove_node
from app.scene.offscreen import SceneError

_ROLE = "MarginGuard"
"""Attribute of our nodes, kept in files. Names are not enough: others use them, too."""
FRAME, SURFACE, PART = "frame", "surface", "part"
_DISPLAYED = (vtkMRMLModelNode, vtkMRMLMarkupsNode)


def mark(node: vtkMRMLNode, role: str) -> None:
    """Mark ``node`` as ours; a role that it already has stays."""
    if node.GetAttribute(_ROLE) is None:
        node.SetAttribute(_ROLE, role)


def is_marked(node: vtkMRMLNode) -> bool:
    """True if ``node`` is one of ours."""
    return node.GetAttribute(_ROLE) is not None


@dataclass(frozen=True, slots=True, eq=False)
class AdoptedNodes:
    """Nodes to reuse, by name, so that nodes of others that refer to them keep doing so.

    ``frames`` are those of the transform tree, ``surfaces`` the tumour and the tool.
    """

    frames: dict[str, vtkMRMLLinearTransformNode] = field(default_factory=dict)
    surfaces: dict[str, vtkMRMLModelNode] = field(default_factory=dict)

    @classmethod
    def in_scene(cls, scene: vtkMRMLScene) -> "AdoptedNodes":
        """Find the nodes in ``scene``; remove those that are created again (marks, robots).

        The surfaces are hidden until they are used, because their colours are those of the time of
        saving. Sequence browsers that play into our nodes are removed for the same reason.
        """
        adopted = cls()
        count = scene.GetNumberOfNodes()
        for node in [scene.GetNthNode(index) for index in range(count)]:
            role, name = node.GetAttribute(_ROLE), node.GetName()
            if role is not None:
                _stop_playing(scene, node)
            if role == FRAME:
                adopted.frames.setdefault(name, node)
            elif role == SURFACE and name not in adopted.surfaces:
                adopted.surfaces[name] = node
                node.SetDisplayVisibility(False)
            elif role is not None and isinstance(node, vtkMRMLDisplayableNode):
                remove_displayed(scene, node)
            elif role is not None:
                remove_node(scene, node)
        return adopted


def _stop_playing(scene: vtkMRMLScene, node: vtkMRMLNode) -> None:
    """Remove browsers whose sequences move or colour ``node``; the sequences stay."""
    played = {node.GetID()}
    if isinstance(node, vtkMRMLDisplayableNode):
        played |= {node.GetNthDisplayNodeID(n) for n in range(node.GetNumberOfDisplayNodes())}
    found = scene.GetNodesByClass(vtkMRMLSequenceBrowserNode.__name__)
    for browser in [found.GetItemAsObject(index) for index in range(found.GetNumberOfItems())]:
        if any(browser.IsProxyNodeID(node_id) for node_id in played):
            scene.RemoveNode(browser)


class NodeIntegrity:
    """Compares nodes with their recorded parents and surfaces."""

    def __init__(self) -> None:
        self._parents: dict[vtkMRMLNode, str | None] = {}
        self._points: dict[vtkMRMLNode, vtkPoints | None] = {}

    def record(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Record ``nodes`` as they are now, instead of those recorded before."""
        placed = [node for node in nodes if isinstance(node, vtkMRMLTransformableNode)]
        models = [node for node in placed if isinstance(node, vtkMRMLModelNode)]
        self._parents = {node: node.GetTransformNodeID() for node in placed}
        self._points = {model: _points(model) for model in models}

    def restore(self, nodes: Iterable[vtkMRMLNode]) -> None:
        """Put each of ``nodes`` back under its recorded parent.

        Raises `SceneError`, which names the node, if a node or its display was removed from the
        scene, or if a model has another surface, as after its transform was hardened.
        """
        for node in nodes:
            if node.GetScene() is None:
                raise _changed(node, "node", "removed from the scene")
            if isinstance(node, _DISPLAYED) and node.GetDisplayNode() is None:
                raise _changed(node, "the display of node", "removed from the scene")
            if node in self._points and _points(node) is not self._points[node]:
                raise _changed(node, "the surface of node", "replaced")
            if node in self._parents and node.GetTransformNodeID() != self._parents[node]:
                node.SetAndObserveTransformNodeID(self._parents[node])


def _points(model: vtkMRMLModelNode) -> vtkPoints | None:
    """The points of the surface: hardening replaces them, but keeps the surface object."""
    surface = model.GetPolyData()
    return None if surface is None else surface.GetPoints()


def _changed(node: vtkMRMLNode, what: str, how: str) -> SceneError:
    return SceneError(
        f"{what} {node.GetName()!r} was {how} outside of MarginGuard; expected it unchanged: "
        "clear the scene and build it again"
    )


class Batch:
    """Holds the events of the nodes that are changed within `changes` until it ends.

    MRML's own batch state is used only where nodes are added or removed (`content`): at its end
    every widget and every displayable manager processes the whole scene, which is too slow for each
    frame of a tracker. The views of the application's ``logic`` do not draw while a batch is open.
    """

    def __init__(self, scene: vtkMRMLScene, logic: vtkMRMLApplicationLogic | None = None) -> None:
        self._scene = scene
        self._logic = logic
        self._depth = 0
        self._held: dict[vtkMRMLNode, int] = {}

    @property
    def is_open(self) -> bool:
        """True within `changes`."""
        return self._depth > 0

    @contextmanager
    def changes(self) -> Iterator[None]:
        """Context of one batch, or of a part of the open one; ends also after an error."""
        self._depth += 1
        if self._depth == 1 and self._logic is not None:
            self._logic.PauseRender()
        try:
            yield
        finally:
            self._depth -= 1
            if self._depth == 0:
                self._release()

    @contextmanager
    def content(self) -> Iterator[None]:
        """Context of `changes` that add or remove nodes."""
        with self.changes():
            self._scene.StartState(vtkMRMLScene.BatchProcessState)
            try:
                yield
            finally:
                self._scene.EndState(vtkMRMLScene.BatchProcessState)

    def hold(self, node: vtkMRMLNode) -> None:
        """Delay the events of ``node``, which is changed next, to the end of the batch."""
        if self._depth and node not in self._held:
            self._held[node] = node.StartModify()

    def _release(self) -> None:
        held, self._held = self._held, {}
        # A transform notifies its children: parents go first, so that a child that has moved, too,
        # has one event for both.
        depths: dict[vtkMRMLNode, int] = {}
        for node, was_held in sorted(held.items(), key=lambda item: _depth_of(item[0], depths)):
            node.EndModify(was_held)
        if self._logic is not None:
            self._logic.ResumeRender()


def _depth_of(node: vtkMRMLNode, known: dict[vtkMRMLNode, int]) -> int:
    """Number of transforms above ``node``; cached in ``known``, because many nodes share them."""
    if node not in known:
        can_hang = isinstance(node, vtkMRMLTransformableNode)
        parent = node.GetParentTransformNode() if can_hang else None
        known[node] = 0 if parent is None else 1 + _depth_of(parent, known)
    return known[node]
