"""A robot in the scene: a transform node and a model node a link."""

from collections.abc import Mapping

import numpy as np
from slicer import vtkMRMLLinearTransformNode, vtkMRMLModelNode, vtkMRMLScene

from app.geometry import Transform, join_transform_name
from app.robot import Link, Robot
from app.scene.batch import Batch
from app.scene.convert import is_at, vtk_matrix
from app.scene.errors import SceneError
from app.scene.models import Rgb, add_model, colored_surface, remove_displayed, remove_node

STALE_COLOR: Rgb = (0.5, 0.5, 0.5)
_DEFAULT_COLOR: Rgb = (0.78, 0.80, 0.83)


class RobotModel:
    """The links of ``robot``, its root link at ``base``, the node of the frame ``base_frame``.

    The root link has a node ``<Root>To<BaseFrame>`` (or is ``base`` when it has that name), every
    other link a node ``<Link>To<Root>`` under it. A link with visuals has a model ``<link>_model``
    that holds all of them in their colours. Links are at their zero pose until `set_links`.
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
        self.transforms: dict[str, vtkMRMLLinearTransformNode] = {}
        self.models: dict[str, vtkMRMLModelNode] = {}
        self._colors: dict[str, Rgb] = {}
        self._known = True
        self.transforms[self._root] = (
            base
            if self._root == base_frame
            else self._add_transform(join_transform_name(self._root, base_frame), base)
        )
        for link in robot.links:
            self._add_link(link)
        self.set_links(robot.forward_kinematics({}))

    def set_links(self, links: Mapping[str, Transform]) -> None:
        """Move every link of ``links`` to its ``root_from_link``; others stay.

        A link that is there already tells nobody. A name that is not the robot's raises
        `SceneError` and moves nothing.
        """
        for name in links:
            if name not in self.transforms:
                raise SceneError(
                    f"link {name!r} is not of the robot in the scene: "
                    f"{', '.join(sorted(self.transforms))} are"
                )
        with self._batch.changes():
            for name, root_from_link in links.items():
                node, matrix = self.transforms[name], vtk_matrix(root_from_link)
                if name != self._root and not is_at(node, matrix):
                    self._batch.hold(node)
                    node.SetMatrixTransformToParent(matrix)

    def set_known(self, known: bool) -> None:
        """Show the links in their colours, or in grey while nobody knows where they are."""
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
        """Take every node of the robot out of the scene; ``base`` is not the robot's and stays."""
        for model in self.models.values():
            remove_displayed(self._scene, model)
        for node in self.transforms.values():
            if node is not self.base:
                remove_node(self._scene, node)
        self.models.clear()
        self.transforms.clear()

    def _add_link(self, link: Link) -> None:
        if link.name != self._root:
            self.transforms[link.name] = self._add_transform(
                join_transform_name(link.name, self._root), self.transforms[self._root]
            )
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

    def _add_transform(
        self, name: str, parent: vtkMRMLLinearTransformNode
    ) -> vtkMRMLLinearTransformNode:
        node = self._scene.AddNewNodeByClass("vtkMRMLLinearTransformNode", name)
        node.SetAndObserveTransformNodeID(parent.GetID())
        return node
