"""The widgets of plans: an approach with its slider, a goal, a needle with its cross-hair."""

from pathlib import Path
from typing import Any

from app.workflow import GhostShown, GoalShown, NeedleShown

from .plans import PlansShown
from .widgets import OnClick, crosshair_picture, show_picture

_NO_PLAN = "no plan"
_NO_ROBOT = "needs a robot whose base is registered"


class PlanSection:
    """Connects the buttons, and shows the plans and the goal."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        self._needle: NeedleShown | None = None
        self._corridors: tuple[str, ...] = ()
        on_click(
            ui.showApproachButton,
            lambda logic: logic.plans.show_approach(_path(ui.approachPathLineEdit)),
        )
        on_click(ui.removeApproachButton, lambda logic: logic.plans.ghost.remove())
        on_click(
            ui.showNeedleButton, lambda logic: logic.plans.show_needle(_path(ui.needlePathLineEdit))
        )
        on_click(
            ui.beginGoalButton,
            lambda logic: logic.plans.goal.begin(ui.goalClearanceSpinBox.property("value")),
        )
        on_click(ui.planGoalButton, lambda logic: logic.plans.goal.plan())
        on_click(ui.endGoalButton, lambda logic: logic.plans.goal.end())
        on_click(ui.removeNeedleButton, lambda logic: logic.plans.needle.remove())
        on_click(
            ui.useCorridorButton,
            lambda logic: logic.plans.needle.choose(ui.corridorComboBox.property("currentIndex")),
        )

    def show(self, shown: PlansShown) -> None:
        """Show ``shown``."""
        self._show_approach(shown.approach)
        self._show_goal(shown.goal)
        self._show_needle(shown.needle)

    def _show_approach(self, shown: GhostShown | None) -> None:
        slider, is_drawn = self._ui.approachSlider, shown is not None and not shown.problem
        slider.setEnabled(is_drawn)
        self._ui.removeApproachButton.setEnabled(shown is not None)
        if shown is None:
            self._ui.approachLabel.setText(_NO_PLAN)
            return
        lines = shown.title, shown.problem or f"{shown.time}: {shown.nearest}; {shown.clearance}"
        self._ui.approachLabel.setText("\n".join(lines))
        if is_drawn and not slider.underMouse():
            slider.blockSignals(True)
            slider.setProperty("maximum", float(shown.last))
            slider.setValue(float(shown.place))
            slider.blockSignals(False)

    def _show_goal(self, shown: GoalShown | None) -> None:
        ui, is_active = self._ui, shown is not None and shown.is_active
        for widget in (ui.beginGoalButton, ui.goalClearanceSpinBox):
            widget.setEnabled(shown is not None and not is_active)
        ui.planGoalButton.setEnabled(shown is not None and shown.can_plan)
        ui.endGoalButton.setEnabled(is_active)
        lines = (_NO_ROBOT,) if shown is None else (shown.place, shown.problem, shown.status)
        ui.goalLabel.setText("\n".join(filter(None, lines)))

    def _show_needle(self, shown: NeedleShown | None) -> None:
        ui = self._ui
        corridors = () if shown is None else shown.corridors
        if corridors != self._corridors:
            self._corridors = corridors
            ui.corridorComboBox.clear()
            ui.corridorComboBox.addItems(list(corridors))
        for widget in (ui.corridorComboBox, ui.useCorridorButton):
            widget.setEnabled(len(corridors) > 1)
        ui.removeNeedleButton.setEnabled(shown is not None)
        ui.needleLabel.setText(_NO_PLAN if shown is None else _text(shown))
        if shown == self._needle:
            return
        self._needle = shown
        is_known = shown is not None and shown.tip is not None
        show_picture(ui.crosshairLabel, crosshair_picture(shown) if is_known else None)


def _path(edit: Any) -> Path:
    return Path(edit.currentPath)


def _text(shown: NeedleShown) -> str:
    name = f"corridor {shown.corridors[shown.corridor]}"
    if shown.problem:
        return f"{name}\n{shown.problem}"
    lines = [
        name,
        f"lateral error {shown.lateral}",
        f"angle {shown.angle}",
        f"depth left {shown.remaining}",
        f"miss at target {shown.miss}",
    ]
    if shown.gate:
        lines += [f"breath: gate {shown.gate.upper()}", shown.gate_text]
    return "\n".join(lines)
