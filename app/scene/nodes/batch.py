"""Groups changes of a scene: each node notifies its observers once, each view draws once."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from slicer import vtkMRMLApplicationLogic, vtkMRMLNode, vtkMRMLScene, vtkMRMLTransformableNode


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
        self._listeners: list[Callable[[], None]] = []

    @property
    def is_open(self) -> bool:
        """True within `changes`."""
        return self._depth > 0

    def on_end(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` at the end of each batch, after all nodes have been notified."""
        self._listeners.append(listener)

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
        for listener in tuple(self._listeners):
            listener()


def _depth_of(node: vtkMRMLNode, known: dict[vtkMRMLNode, int]) -> int:
    """Number of transforms above ``node``; cached in ``known``, because many nodes share them."""
    if node not in known:
        can_hang = isinstance(node, vtkMRMLTransformableNode)
        parent = node.GetParentTransformNode() if can_hang else None
        known[node] = 0 if parent is None else 1 + _depth_of(parent, known)
    return known[node]
