"""The parts of the page that show plans: the ghost of an approach, and a needle on its corridor."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from app.geometry import FloatArray
from app.scene import PlannedModels
from app.scene.convert import world_matrix, world_triangles
from app.viewer.drawing.grips import PicturePoints, first_hit
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.messages.checks import Commands, integer, number, numbers
from app.viewer.messages.methods import Event
from app.viewer.pointer_parts import PageDrag, place_of
from app.viewer.view_state import ViewState
from app.workflow import RANGE_MM, RINGS_MM, ApproachGhost, GoalPose, NeedleGuide

_MAX_NUMBER = 1_000_000
_MAX_MOVE_MM, _MAX_CLEARANCE_MM = 1000.0, 100.0


def planned_parts(plans: tuple[ApproachGhost, NeedleGuide] | None) -> tuple[Part, ...]:
    """The parts of the scene that ``plans`` have; an arm may execute an approach at any time."""
    if plans is None:
        return ()
    return (Part.GHOST, Part.CORRIDOR) if plans[1].has_plan else (Part.GHOST,)


class PlanPart:
    """Shows ``ghost`` and ``needle`` in the scene and as values. The page's thread owns it."""

    def __init__(
        self, ghost: ApproachGhost, needle: NeedleGuide, goal: GoalPose | None = None
    ) -> None:
        self._ghost, self._needle, self._goal = ghost, needle, goal
        self._models: PlannedModels | None = None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        goal = None if self._goal is None else self._goal.revision
        return self._ghost.revision, self._needle.revision, goal

    def update(self, shown: ViewState, view: SceneView) -> bool:
        """Show the moment ``shown``; True if there are other models."""
        content = shown.content
        if self._goal is not None:
            self._goal.update(content, shown.step, shown.silent)
        self._ghost.update(content)
        self._needle.update(shown.step, content, shown.silent)
        models = self._models
        if models is not None and models.scene is not view.scene:
            models.remove()
            models = self._models = None
        if models is None:
            if view.scene is None:
                return False
            models = self._models = PlannedModels(view.scene)
        ghost, goal = self._ghost, self._goal
        links = ghost.links if goal is None else goal.links_before(ghost)
        models.show(content, links, self._needle.surface)
        corridor = {} if models.corridor is None else {"corridor": models.corridor}
        is_ghost_new = view.use_models(Part.GHOST, models.links)
        return view.use_models(Part.CORRIDOR, corridor) or is_ghost_new

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        ghost, needle = self._ghost.shown(), self._needle.shown()
        goal = None if self._goal is None else self._goal.shown()
        scale = {"range": RANGE_MM, "rings": RINGS_MM}
        return {
            "approach": None if ghost is None else asdict(ghost),
            "goal": None if goal is None else asdict(goal),
            "guidance": None if needle is None else asdict(needle) | scale,
        }


def add_plan_controls(commands: Commands, ghost: ApproachGhost, needle: NeedleGuide) -> None:
    """Moves the ghost along its way, and chooses the corridor."""
    commands.add("approach_place", ghost.go_to, integer(0, _MAX_NUMBER))
    commands.add("corridor", needle.choose, integer(0, _MAX_NUMBER))


def add_goal_controls(commands: Commands, goal: GoalPose) -> None:
    """Sets ``goal``, moves it in mm and degrees along the robot's axes, and asks for a plan."""

    def move(way_mm: tuple[float, ...], turn_deg: tuple[float, ...]) -> None:
        goal.hold()
        if goal.place_mm is not None:
            goal.turn(np.radians(turn_deg))
            goal.move_to(goal.place_mm + np.array(way_mm))

    way = numbers(3, -_MAX_MOVE_MM, _MAX_MOVE_MM)
    commands.add("goal_begin", goal.begin, number(0.1, _MAX_CLEARANCE_MM))
    commands.add("goal_move", move, way, numbers(3, -180.0, 180.0))
    commands.add("goal_plan", goal.plan)
    commands.add("goal_end", goal.end)


class GoalDrag(PageDrag):
    """Drags the ghost at ``goal``: its tip moves in the plane that faces the camera."""

    def __init__(self, view: SceneView, goal: GoalPose, changed: Callable[[], None]) -> None:
        super().__init__()
        self._view, self._goal, self._changed = view, goal, changed
        self._picture = PicturePoints(view)
        self._offset_mm: FloatArray = np.zeros(3)

    def _begin(self, event: Event) -> bool:
        is_plain = not any(event[key] for key in ("ctrlKey", "altKey", "shiftKey"))
        if event["type"] != "LeftButtonPress" or not is_plain:
            return False
        at, tip = place_of(event), self._tip()
        if tip is None or not self._hits(at):
            return False
        on_plane = self._picture.on_plane(at, tip[1])
        if on_plane is None:
            return False
        self._offset_mm = tip[1] - on_plane
        self._goal.hold()
        return True

    def _move(self, event: Event) -> bool:
        tip = self._tip()
        if tip is not None:
            ras_from_root, tip_mm = tip
            on_plane = self._picture.on_plane(place_of(event), tip_mm)
            if on_plane is not None:
                place = np.linalg.inv(ras_from_root) @ [*(on_plane + self._offset_mm), 1.0]
                self._goal.move_to(place[:3])
                self._changed()
        return True

    def _hits(self, at: FloatArray) -> bool:
        near, far = self._picture.ray(at)
        models = self._view.added.get(Part.GHOST, {}).values()
        return any(first_hit(near, far, world_triangles(each)) is not None for each in models)

    def _tip(self) -> tuple[FloatArray, FloatArray] | None:
        """``ras_from_root`` (4, 4) and the goal's tip (3,) in RAS; None without a goal."""
        place_mm, scene, robot = self._goal.place_mm, self._view.scene, self._view.content.robot
        node = None if scene is None or robot is None else scene.tree.node(robot.base_frame)
        if place_mm is None or node is None:
            return None
        ras_from_root = world_matrix(node)
        return ras_from_root, (ras_from_root @ [*place_mm, 1.0])[:3]
