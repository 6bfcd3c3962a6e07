"""Many frames of one root in the scene, moved together and often."""

from collections.abc import Sequence

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import FloatArray, join_transform_name
from app.scene.errors import SceneError


class PoseNodes:
    """A node ``<Frame>To<Root>`` for each of ``frames``, all of them under ``parent``.

    ``parent`` is the node of ``root``; without one, ``root`` is the scene's world. Call it in the
    thread that owns the scene.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        root: str,
        frames: Sequence[str],
        parent: vtkMRMLLinearTransformNode | None = None,
    ) -> None:
        if len(set(frames)) < len(frames):
            raise SceneError(f"frames of {root!r} are given twice: {', '.join(sorted(frames))}")
        self._scene = scene
        self._frames = tuple(frames)
        self._matrix = vtkMatrix4x4()
        self.nodes: dict[str, vtkMRMLLinearTransformNode] = {}
        for frame in frames:
            name = join_transform_name(frame, root)
            node = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
            if parent is not None:
                node.SetAndObserveTransformNodeID(parent.GetID())
            self.nodes[frame] = node
        self._shown: list[list[float]] = [[]] * len(frames)

    def move(self, root_from_frames: FloatArray) -> int:
        """Put every frame where it is, (n, 4, 4) in mm in their order; how many have moved.

        A frame that has moved tells its observers once, one that has not tells nobody. All
        observers have been called on return. Raises `SceneError`, and moves nothing, for another
        shape or a value that is not finite.
        """
        wanted = (len(self._frames), 4, 4)
        if root_from_frames.shape != wanted:
            raise SceneError(f"poses have shape {root_from_frames.shape}: {wanted} wanted")
        if not np.isfinite(root_from_frames).all():
            bad = ~np.isfinite(root_from_frames).all(axis=(1, 2))
            frame = self._frames[int(np.argmax(bad))]
            raise SceneError(f"the pose of frame {frame!r} is not finite")
        moved = 0
        rows = root_from_frames.reshape(-1, 16).tolist()
        for place, (node, row) in enumerate(zip(self.nodes.values(), rows, strict=True)):
            if row != self._shown[place]:
                self._matrix.DeepCopy(row)
                node.SetMatrixTransformToParent(self._matrix)
                self._shown[place] = row
                moved += 1
        return moved

    def remove(self) -> None:
        """Take the nodes out of the scene."""
        for node in self.nodes.values():
            self._scene.RemoveNode(node)
        self.nodes.clear()
