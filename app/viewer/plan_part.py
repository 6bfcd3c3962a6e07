"""The parts of the page that show plans: the ghost of an approach, and a needle on its corridor."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from app.scene import PlannedModels
from app.viewer.drawing.scene_view import Part, SceneView
from app.viewer.messages.checks import Commands, integer
from app.viewer.view_state import ViewState
from app.workflow import RANGE_MM, RINGS_MM, ApproachGhost, NeedleGuide

_MAX_NUMBER = 1_000_000


def planned_parts(plans: tuple[ApproachGhost, NeedleGuide] | None) -> tuple[Part, ...]:
    """The parts of the scene that ``plans`` have; an arm may execute an approach at any time."""
    if plans is None:
        return ()
    return (Part.GHOST, Part.CORRIDOR) if plans[1].has_plan else (Part.GHOST,)


class PlanPart:
    """Shows ``ghost`` and ``needle`` in the scene and as values. The page's thread owns it."""

    def __init__(self, ghost: ApproachGhost, needle: NeedleGuide) -> None:
        self._ghost, self._needle = ghost, needle
        self._models: PlannedModels | None = None

    @property
    def revision(self) -> object:
        """A value that changes when the page needs an update without a new step."""
        return self._ghost.revision, self._needle.revision

    def update(self, shown: ViewState, view: SceneView) -> bool:
        """Show the moment ``shown``; True if there are other models."""
        content = shown.content
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
        models.show(content, self._ghost.links, self._needle.surface)
        corridor = {} if models.corridor is None else {"corridor": models.corridor}
        is_ghost_new = view.use_models(Part.GHOST, models.links)
        return view.use_models(Part.CORRIDOR, corridor) or is_ghost_new

    def values(self) -> dict[str, Any]:
        """The values of the page that belong to the last `update`."""
        ghost, needle = self._ghost.shown(), self._needle.shown()
        scale = {"range": RANGE_MM, "rings": RINGS_MM}
        return {
            "approach": None if ghost is None else asdict(ghost),
            "guidance": None if needle is None else asdict(needle) | scale,
        }


class PlanControls:
    """Moves the ghost along its way, and chooses the corridor."""

    def __init__(
        self,
        commands: Commands,
        ghost: ApproachGhost,
        needle: NeedleGuide,
        changed: Callable[[], None],
    ) -> None:
        def go_to(place: int) -> None:
            ghost.go_to(place)
            changed()

        def choose(corridor: int) -> None:
            needle.choose(corridor)
            changed()

        commands.add("approach_place", go_to, integer(0, _MAX_NUMBER))
        commands.add("corridor", choose, integer(0, _MAX_NUMBER))
