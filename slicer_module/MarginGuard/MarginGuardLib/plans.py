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
from .live_step_run import LiveStepRun
from .shown_session import ShownSession


@dataclass(frozen=True, slots=True)
class PlansShown:
    """Texts of the plans; None without one."""

    approach: GhostShown | None = None
    needle: NeedleShown | None = None
    goal: GoalShown | None = None


class PanelPlans:
    """Shows plans of files in the scene of ``session`` and later ones; live the executed plan.

    Call it in the scene's thread.
    """

    def __init__(self, session: ShownSession) -> None:
        self._ghost, self._needle = ApproachGhost(), NeedleGuide()
        self.goal = GoalPose(self._ask, self._ghost.choose)
        self._handle = GoalHandle(self.goal)
        self._session = session
        self._models: PlannedModels | None = None
        self._executed = ""

    def show_approach(self, path: Path) -> None:
        """Show the plan of ``marginguard plan approach`` in a file. Raises `InputError`."""
        self._ghost.read(_file(path))

    def remove_approach(self) -> None:
        """Show no approach of a file."""
        self._ghost.remove()

    def go_to(self, place: int) -> None:
        """Show the robot at the time of number ``place`` of the approach."""
        self._ghost.go_to(place)

    def show_needle(self, path: Path) -> None:
        """Show the corridors of ``marginguard plan needle`` in a file. Raises `InputError`."""
        self._needle.read(_file(path))

    def remove_needle(self) -> None:
        """Show no corridor."""
        self._needle.remove()

    def use_corridor(self, number: int) -> None:
        """Guide the needle on the corridor of ``number``, from 0. Raises `InputError`."""
        self._needle.choose(number)

    def update(self) -> None:
        """Show the plans with the step that is shown now."""
        session = self._session
        run = self._live_run()
        executed = "" if run is None else run.executed_plan
        if executed != self._executed:
            self._executed = executed
            self._ghost.execute(executed)
        display, step = session.display, session.shown_step
        scene = None if display is None else display.scene
        if self._models is not None and self._models.scene is not scene:
            self.clear()
        if display is None or scene is None or step is None:
            return
        self._ghost.update(display.content)
        self._needle.update(step, display.content, session.silent)
        if self._models is None:
            self._models = PlannedModels(scene)
        # The handle first: a plan that has come is not for a goal that has moved since.
        self._handle.update(scene, display.content, step)
        self.goal.update(display.content, step, session.silent)
        links = self.goal.links_before(self._ghost)
        self._models.show(display.content, links, self._needle.surface)

    def shown(self) -> PlansShown:
        """Texts at the last `update`; none without a session."""
        if self._models is None:
            return PlansShown()
        return PlansShown(self._ghost.shown(), self._needle.shown(), self.goal.shown())

    def clear(self) -> None:
        """Remove the nodes from the scene; the plans are shown in the next session again."""
        if self._models is not None:
            self._models.remove()
        self._models = None
        self.goal.end()
        self._handle.remove()

    def _live_run(self) -> LiveStepRun | None:
        thread = self._session.thread
        run = None if thread is None else thread.run
        return run if isinstance(run, LiveStepRun) else None

    def _ask(
        self, joints: Mapping[str, float], clearance_mm: float, answer: Answer
    ) -> Callable[[], None]:
        run = self._live_run()
        plan = None if run is None else run.plan
        if plan is None:
            answer("", "approach: the session is not live; expected a live one")
            return lambda: None
        return plan(joints, clearance_mm, answer)


def _file(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the JSON of a plan")
    return path
