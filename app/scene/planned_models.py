"""Plans beside a session in the scene: the robot of an approach as a ghost, a needle's corridor."""

from collections.abc import Mapping

from slicer import vtkMRMLModelNode, vtkMRMLNode

from app.geometry import SurfaceMesh, Transform
from app.robot import Robot
from app.runtime import SessionContent
from app.scene.models import add_model, remove_displayed, smooth_surface
from app.scene.robot_model import RobotModel
from app.scene.scene import MarginGuardScene
from app.scene.scene_nodes import PART, mark

PLAN_COLOR = (0.35, 0.72, 1.0)
"""Differs from the colour of each state."""
GHOST_OPACITY = 0.3
_PREFIX = "Planned_"


class PlannedModels:
    """Nodes in ``scene``, whose names begin with ``Planned_``. They are not saved with the scene.

    The ghost is below the node of the robot's base, the corridor below that of its frame; without
    the node of its frame nothing is drawn. Not thread-safe.
    """

    def __init__(self, scene: MarginGuardScene) -> None:
        self.scene = scene
        self._ghost: RobotModel | None = None
        self._robot: Robot | None = None
        self._links: Mapping[str, Transform] = {}
        self._surface: SurfaceMesh | None = None
        self.corridor: vtkMRMLModelNode | None = None

    @property
    def links(self) -> dict[str, vtkMRMLModelNode]:
        """Models of the ghost, by link."""
        return {} if self._ghost is None else self._ghost.models

    def show(
        self,
        content: SessionContent,
        links: Mapping[str, Transform],
        corridor: SurfaceMesh | None,
    ) -> None:
        """Show the robot of ``content`` at ``links``, its ``root_from_link``, and ``corridor``.

        Nothing is drawn of empty ``links``, and of None. ``links`` are not changed afterwards.
        """
        robot = content.robot if links else None
        if robot is not None and self.scene.tree.node(robot.base_frame) is not None:
            self._show_ghost(robot.robot, robot.base_frame, links)
        else:
            self._show_ghost(None, "", {})
        self._show_corridor(corridor)

    def _show_ghost(
        self, robot: Robot | None, base_frame: str, links: Mapping[str, Transform]
    ) -> None:
        if robot is not self._robot:
            self._robot = robot
            with self.scene.batch.content():
                if self._ghost is not None:
                    self._ghost.remove()
                self._ghost = None if robot is None else self._new_ghost(robot, base_frame)
        if self._ghost is not None and links is not self._links:
            self._ghost.set_links(links)
        self._links = links

    def _new_ghost(self, robot: Robot, base_frame: str) -> RobotModel:
        base = self.scene.tree.node(base_frame)
        ghost = RobotModel(self.scene.scene, robot, base, base_frame, self.scene.batch)
        for node in (*ghost.models.values(), *ghost.transforms.values()):
            if node is not base:
                _name(node)
        for model in ghost.models.values():
            display = model.GetDisplayNode()
            display.SetScalarVisibility(False)
            display.SetColor(*PLAN_COLOR)
            display.SetOpacity(GHOST_OPACITY)
        return ghost

    def _show_corridor(self, surface: SurfaceMesh | None) -> None:
        parent = None if surface is None else self.scene.tree.node(surface.frame)
        shown = surface if parent is not None else None
        if shown is self._surface:
            return
        self._surface = shown
        with self.scene.batch.content():
            if self.corridor is not None:
                remove_displayed(self.scene.scene, self.corridor)
                self.corridor = None
            if shown is not None:
                self.corridor = add_model(
                    self.scene.scene, "Corridor", smooth_surface(shown), PLAN_COLOR, parent=parent
                )
                _name(self.corridor)

    def remove(self) -> None:
        """Remove all nodes."""
        self._show_ghost(None, "", {})
        self._show_corridor(None)


def _name(node: vtkMRMLNode) -> None:
    node.SetName(f"{_PREFIX}{node.GetName()}")
    mark(node, PART)
    node.SaveWithSceneOff()
