"""Plans beside the shown session: the ghost of an approach, and a needle on its corridor."""

from dataclasses import dataclass
from pathlib import Path

from app.geometry import InputError
from app.scene import PlannedModels
from app.workflow import ApproachGhost, GhostShown, NeedleGuide, NeedleShown

from .live_step_run import LiveStepRun
from .shown_session import ShownSession


@dataclass(frozen=True, slots=True)
class PlansShown:
    """Texts of the plans; None without one."""

    approach: GhostShown | None = None
    needle: NeedleShown | None = None


class PanelPlans:
    """Shows plans of files in the scene of ``session`` and later ones; live the executed plan.

    Call it in the scene's thread.
    """

    def __init__(self, session: ShownSession) -> None:
        self._ghost, self._needle = ApproachGhost(), NeedleGuide()
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
        run = None if session.thread is None else session.thread.run
        executed = run.executed_plan if isinstance(run, LiveStepRun) else ""
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
        self._models.show(display.content, self._ghost.links, self._needle.surface)

    def shown(self) -> PlansShown:
        """Texts at the last `update`; none without a session."""
        if self._models is None:
            return PlansShown()
        return PlansShown(self._ghost.shown(), self._needle.shown())

    def clear(self) -> None:
        """Remove the nodes from the scene; the plans are shown in the next session again."""
        if self._models is not None:
            self._models.remove()
        self._models = None


def _file(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the JSON of a plan")
    return path
