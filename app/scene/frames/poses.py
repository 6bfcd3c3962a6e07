"""Transform nodes of several frames under one root, moved together."""

from collections.abc import Sequence

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.geometry import FloatArray, join_transform_name
from app.scene.errors import SceneError
from app.scene.nodes.batch import Batch
from app.scene.nodes.models import remove_node


class PoseNodes:
    """A node ``<Frame>To<Root>`` for each of ``frames``, under ``parent``.

    ``parent`` is the node of ``root``; None: ``root`` is the scene's world. A node that a user has
    moved is put back by the next `move`. Call it in the thread that owns the scene. Raises
    `SceneError` for a frame that is given twice.
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
            raise SceneError(
                f"frames of {root!r}: {', '.join(sorted(frames))}; expected each frame once"
            )
        self._scene = scene
        self._batch = batch or Batch(scene)
        self._frames = tuple(frames)
        self._present, self._next = vtkMatrix4x4(), vtkMatrix4x4()
        self.nodes: dict[str, vtkMRMLLinearTransformNode] = {}
        for frame in frames:
            name = join_transform_name(frame, root)
            node = scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
            if parent is not None:
                node.SetAndObserveTransformNodeID(parent.GetID())
            self.nodes[frame] = node

    def move(self, root_from_frames: FloatArray) -> int:
        """Set the poses (n, 4, 4) in mm in the order of the frames; return how many have changed.

        A node that has moved notifies its observers once, at the end of the open batch or at once
        without one. Raises `SceneError`, and moves nothing, for another shape and for a value that
        is not finite.
        """
        shape = (len(self._frames), 4, 4)
        if root_from_frames.shape != shape:
            raise SceneError(f"poses: shape is {root_from_frames.shape}; expected {shape}")
        if not np.isfinite(root_from_frames).all():
            bad = ~np.isfinite(root_from_frames).all(axis=(1, 2))
            frame = self._frames[int(np.argmax(bad))]
            raise SceneError(f"pose of frame {frame!r}: not finite; expected finite numbers")
        moved = 0
        rows = map(tuple, root_from_frames.reshape(-1, 16).tolist())
        with self._batch.changes():
            for node, row in zip(self.nodes.values(), rows, strict=True):
                node.GetMatrixTransformToParent(self._present)
                if self._present.GetData() != row:
                    self._batch.hold(node)
                    self._next.DeepCopy(row)
                    node.SetMatrixTransformToParent(self._next)
                    moved += 1
        return moved

    def remove(self) -> None:
        """Remove the nodes from the scene."""
        for node in self.nodes.values():
            remove_node(self._scene, node)
        self.nodes.clear()
