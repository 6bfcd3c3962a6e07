"""Many frames of one root in the scene, moved together and often."""

from collections.abc import Sequence

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import FloatArray, join_transform_name
from app.scene.errors import SceneError
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_node


class PoseNodes:
    """A node ``<Frame>To<Root>`` for each of ``frames``, all of them under ``parent``.

    ``parent`` is the node of ``root``; without one, ``root`` is the scene's world. A node that
    somebody else has moved is put back by the next `move`. Call it in the thread that owns the
    scene.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        root: str,
        frames: Sequence[str],
        parent: vtkMRMLLinearTransformNode | None = None,
        batch: Batch | None = None,
    ) -> None:
        if len(set(frames)) < len(frames):
            raise SceneError(f"frames of {root!r} are given twice: {', '.join(sorted(frames))}")
        self._scene = scene
        self._batch = batch or Batch(scene)
        self._frames = tuple(frames)
        self._present, self._wanted = vtkMatrix4x4(), vtkMatrix4x4()
        self.nodes: dict[str, vtkMRMLLinearTransformNode] = {}
        for frame in frames:
            name = join_transform_name(frame, root)
            node = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
            if parent is not None:
                node.SetAndObserveTransformNodeID(parent.GetID())
            self.nodes[frame] = node

    def move(self, root_from_frames: FloatArray) -> int:
        """Put every frame where it is, (n, 4, 4) in mm in their order; how many have moved.

        A frame that has moved tells its observers once, one that has not tells nobody. All
        observers have been called at the end of the batch, which is on return where none is open.
        Raises `SceneError`, and moves nothing, for another shape or a value that is not finite.
        """
        wanted = (len(self._frames), 4, 4)
        if root_from_frames.shape != wanted:
            raise SceneError(f"poses have shape {root_from_frames.shape}: {wanted} wanted")
        if not np.isfinite(root_from_frames).all():
            bad = ~np.isfinite(root_from_frames).all(axis=(1, 2))
            frame = self._frames[int(np.argmax(bad))]
            raise SceneError(f"the pose of frame {frame!r} is not finite")
        moved = 0
        rows = map(tuple, root_from_frames.reshape(-1, 16).tolist())
        with self._batch.changes():
            for node, row in zip(self.nodes.values(), rows, strict=True):
                node.GetMatrixTransformToParent(self._present)
                if self._present.GetData() != row:
                    self._batch.hold(node)
                    self._wanted.DeepCopy(row)
                    node.SetMatrixTransformToParent(self._wanted)
                    moved += 1
        return moved

    def remove(self) -> None:
        """Take the nodes out of the scene."""
        for node in self.nodes.values():
            remove_node(self._scene, node)
        self.nodes.clear()
