"""Bodies of a simulated world in the scene: the physics moves them, and a user's edit is a request.

A frame has one owner. The simulation owns those of its bodies, so that an edit is not a pose but a
request to it; what the scene then shows is what the physics has made of it.
"""

from collections.abc import Callable, Iterable

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene

from app.geometry import NS_PER_MS, MarginGuardError, Stamp, Transform
from app.scene.frames.transform_tree import RAS, TransformTree

ANSWER_NS = 300 * NS_PER_MS
"""After an edit a body stays where the user has put it, until the physics has it there, or so."""
_SAME_MM = 0.01

Request = Callable[[list[Transform], Stamp], None]
Refused = Callable[[MarginGuardError], None]


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
