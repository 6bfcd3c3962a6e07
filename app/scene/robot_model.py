"""A robot in the scene: one transform node and one model node per link."""

from collections.abc import Mapping, Sequence

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode, vtkMRMLScene
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from app.fixture import MarginState
from app.geometry import FloatArray, Transform, join_transform_name
from app.robot import Link, Robot
from app.scene.models import Rgb, add_model, colored_surface, remove_displayed, remove_node
from app.scene.offscreen import SceneError
from app.scene.scene_nodes import Batch

STALE_COLOR: Rgb = MarginState.UNKNOWN.color
_DEFAULT_COLOR: Rgb = (0.78, 0.80, 0.83)


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


class RobotModel:
    """Nodes of the links of ``robot``, whose root link is at ``base``, the node of ``base_frame``.

    The root link has a node ``<Root>To<BaseFrame>``, or is ``base`` itself if its name is
    ``base_frame``. Every other link has a node ``<Link>To<Root>`` under it. A link with visuals has
    one model ``<link>_model`` of all of them in their colours. Links are at their zero pose until
    `set_links`.
    """

    def __init__(
        self,
        scene: vtkMRMLScene,
        robot: Robot,
        base: vtkMRMLLinearTransformNode,
        base_frame: str,
        batch: Batch | None = None,
    ) -> None:
        self._scene = scene
        self._batch = batch or Batch(scene)
        self._root = robot.root_link
        self.base = base
        self.models: dict[str, vtkMRMLModelNode] = {}
        self._colors: dict[str, Rgb] = {}
        self._known = True
        root = base if self._root == base_frame else self._add_root(base_frame)
        moving = [link.name for link in robot.links if link.name != self._root]
        self._moving = PoseNodes(scene, self._root, moving, root, self._batch)
        self._indices = {link: index for index, link in enumerate(moving)}
        self._root_from_links = np.tile(np.eye(4), (len(moving), 1, 1))
        self.transforms: dict[str, vtkMRMLLinearTransformNode] = {
            self._root: root,
            **self._moving.nodes,
        }
        for link in robot.links:
            self._add_link(link)
        self.set_links(robot.forward_kinematics({}))

    def set_links(self, links: Mapping[str, Transform]) -> None:
        """Move each link in ``links`` to its ``root_from_link``; the others stay where they are.

        A link that does not move notifies no observer. Raises `SceneError`, and moves nothing, for
        a name that is no link of the robot.
        """
        for name in links:
            if name not in self.transforms:
                raise SceneError(
                    f"link {name!r} is not a link of the robot; expected one of "
                    f"{', '.join(sorted(self.transforms))}"
                )
        if not links:
            return
        root_from_links = self._root_from_links.copy()
        for name, root_from_link in links.items():
            if name != self._root:
                matrix = root_from_links[self._indices[name]]
                matrix[:3, :3] = root_from_link.rotation
                matrix[:3, 3] = root_from_link.translation_mm
        self._moving.move(root_from_links)
        self._root_from_links = root_from_links

    def restore(self) -> None:
        """Put links that a user has moved back to where they were set."""
        self._moving.move(self._root_from_links)

    def set_known(self, known: bool) -> None:
        """Show the links in their colours if their poses are ``known``, else in grey."""
        if known == self._known:
            return
        self._known = known
        with self._batch.changes():
            for link, model in self.models.items():
                display = model.GetDisplayNode()
                self._batch.hold(display)
                display.SetScalarVisibility(known)
                display.SetColor(*(self._colors[link] if known else STALE_COLOR))

    def remove(self) -> None:
        """Remove the robot's nodes from the scene; ``base`` stays."""
        for model in self.models.values():
            remove_displayed(self._scene, model)
        self._moving.remove()
        root = self.transforms.get(self._root, self.base)
        if root is not self.base:
            remove_node(self._scene, root)
        self.models.clear()
        self.transforms.clear()

    def _add_link(self, link: Link) -> None:
        if not link.visuals:
            return
        parts = [
            (
                shape.mesh,
                np.array(shape.color or _DEFAULT_COLOR)
                if shape.face_colors is None
                else shape.face_colors,
            )
            for shape in link.visuals
        ]
        first = link.visuals[0].color
        self._colors[link.name] = first[:3] if first else _DEFAULT_COLOR
        self.models[link.name] = add_model(
            self._scene,
            f"{link.name}_model",
            colored_surface(parts),
            self._colors[link.name],
            parent=self.transforms[link.name],
        )

    def _add_root(self, base_frame: str) -> vtkMRMLLinearTransformNode:
        name = join_transform_name(self._root, base_frame)
        node = self._scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
        node.SetAndObserveTransformNodeID(self.base.GetID())
        return node
