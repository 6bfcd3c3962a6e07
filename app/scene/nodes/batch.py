"""Many changes of the scene as one: each node tells its observers once, each view draws once."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from slicer import vtkMRMLApplicationLogic, vtkMRMLNode, vtkMRMLScene, vtkMRMLTransformableNode


class Batch:
    """Holds the events of the nodes that are changed in `changes` until it ends.

    MRML's own batch state is kept for nodes that come and go (`content`): at its end every widget
    and every displayable manager looks at the whole scene anew, which is too much for each frame
    of a tracker. ``logic`` is the application's: its views do not draw while a batch is open.
    """

    def __init__(self, scene: vtkMRMLScene, logic: vtkMRMLApplicationLogic | None = None) -> None:
        self._scene = scene
        self._logic = logic
        self._depth = 0
        self._held: dict[vtkMRMLNode, int] = {}
        self._listeners: list[Callable[[], None]] = []

    @property
    def is_open(self) -> bool:
        """Whether `changes` are being made."""
        return self._depth > 0

    def on_end(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` at the end of each batch, when all of it is in place: draw now."""
        self._listeners.append(listener)

    @contextmanager
    def changes(self) -> Iterator[None]:
        """One batch, or a part of the one that is open; it ends also when an error passes."""
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
        """`changes` in which nodes are added or removed."""
        with self.changes():
            self._scene.StartState(vtkMRMLScene.BatchProcessState)
            try:
                yield
            finally:
                self._scene.EndState(vtkMRMLScene.BatchProcessState)

    def hold(self, node: vtkMRMLNode) -> None:
        """To be called before ``node`` is changed: in a batch its events wait for the end."""
        if self._depth and node not in self._held:
            self._held[node] = node.StartModify()

    def _release(self) -> None:
        held, self._held = self._held, {}
        # A transform tells what hangs from it: parents first, so that a child that moved as well
        # has one event for both.
        depths: dict[vtkMRMLNode, int] = {}
        for node, was_held in sorted(held.items(), key=lambda item: _depth_of(item[0], depths)):
            node.EndModify(was_held)
        if self._logic is not None:
            self._logic.ResumeRender()
        for listener in tuple(self._listeners):
            listener()


def _depth_of(node: vtkMRMLNode, known: dict[vtkMRMLNode, int]) -> int:
    """How many transforms ``node`` hangs from; kept in ``known``, for many nodes share them."""
    if node not in known:
        can_hang = isinstance(node, vtkMRMLTransformableNode)
        parent = node.GetParentTransformNode() if can_hang else None
        known[node] = 0 if parent is None else 1 + _depth_of(parent, known)
    return known[node]
