"""Plans beside the shown session: an approach with a goal by hand, and a needle on its corridor."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from app.geometry import InputError
from app.scene import PlannedModels
from app.workflow import (
    ApproachGhost,
    GhostShown,
    GoalPose,
    GoalShown,
    NeedleGuide,
    NeedleShown,
)
from app.workflow.goal_pose import Answer

from .goal_handle import GoalHandle
from .shown_session import ShownSession


@dataclass(frozen=True, slots=True)
class PlansShown:
    """Texts of the plans; None without one."""

    approach: GhostShown | None = None
    needle: NeedleShown | None = None
    goal: GoalShown | None = None


class PanelPlans:
    """Shows plans of files in the scene of ``session`` and later ones; live the executed plan.

    ``ghost`` is the approach, ``needle`` its corridors. Call it in the scene's thread.
    """

    def __init__(self, session: ShownSession) -> None:
        self.ghost, self.needle = ApproachGhost(), NeedleGuide()
        self.goal = GoalPose(self._ask, self.ghost.choose)
        self._handle = GoalHandle(self.goal)
        self._session = session
        self._models: PlannedModels | None = None
        self._executed = ""

    def show_approach(self, path: Path) -> None:
        """Show the plan of ``marginguard plan approach`` in a file. Raises `InputError`."""
        self.ghost.read(_file(path))

    def show_needle(self, path: Path) -> None:
        """Show the corridors of ``marginguard plan needle`` in a file. Raises `InputError`."""
        self.needle.read(_file(path))

    def update(self) -> None:
        """Show the plans with the step that is shown now."""
        session = self._session
        run = session.live
        executed = "" if run is None else run.executed_plan
        if executed != self._executed:
            self._executed = executed
            self.ghost.execute(executed)
        display, step = session.display, session.shown_step
        scene = None if display is None else display.scene
        if self._models is not None and self._models.scene is not scene:
            self.clear()
        if display is None or scene is None or step is None:
            return
        self.ghost.update(display.content)
        self.needle.update(step, display.content, session.silent)
        if self._models is None:
            self._models = PlannedModels(scene)
        # The handle first: a plan that has come is not for a goal that has moved since.
        self._handle.update(scene, display.content, step)
        self.goal.update(display.content, step, session.silent)
        links = self.goal.links_before(self.ghost)
        self._models.show(display.content, links, self.needle.surface)

    def shown(self) -> PlansShown:
        """Texts at the last `update`; none without a session."""
        if self._models is None:
            return PlansShown()
        return PlansShown(self.ghost.shown(), self.needle.shown(), self.goal.shown())

    def clear(self) -> None:
        """Remove the nodes from the scene; the plans are shown in the next session again."""
        if self._models is not None:
            self._models.remove()
        self._models = None
        self.goal.end()
        self._handle.remove()

    def _ask(
        self, joints: Mapping[str, float], clearance_mm: float, answer: Answer
    ) -> Callable[[], None]:
        run = self._session.live
        plan = None if run is None else run.plan
        if plan is None:
            answer("", "approach: the session is not live; expected a live one")
            return lambda: None
        return plan(joints, clearance_mm, answer)


def _file(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the JSON of a plan")
    return path
