"""The widgets of contouring."""

from collections.abc import Callable
from typing import Any

import slicer

from .contour import ContourShown
from .tool_choice import ToolChoice


class ContourSection:
    """Connects the buttons, and shows the contour.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._ui = ui
        self._tool = ToolChoice(ui.tipToolComboBox)
        for button, command in (
            (ui.placePointsButton, lambda logic: logic.contour.place()),
            (ui.tipPointButton, lambda logic: logic.contour.add_tip(self._tool.tool)),
            (ui.eraseAtTipButton, self._erase),
            (ui.undoPointButton, lambda logic: logic.contour.undo()),
            (ui.deletePointsButton, self._delete_all),
            (ui.useContourButton, self._use),
        ):
            on_click(button, command)

    def show(self, shown: ContourShown, stylus: str) -> None:
        """Show ``shown``; ``stylus``: its tip in words, empty without one."""
        ui = self._ui
        self._tool.show(stylus)
        ui.contourLabel.setText(shown.text)
        ui.placePointsButton.setEnabled(shown.can_edit)
        ui.tipPointButton.setEnabled(shown.can_edit)
        ui.eraseAtTipButton.setEnabled(shown.has_points)
        ui.undoPointButton.setEnabled(shown.can_undo)
        ui.deletePointsButton.setEnabled(shown.has_points)
        ui.useContourButton.setEnabled(shown.can_use)

    def _erase(self, logic: Any) -> None:
        logic.contour.erase_at_tip(self._ui.eraseRadiusSpinBox.property("value"))

    def _delete_all(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay("Delete all points of the contour?"):
            logic.contour.delete_all()

    def _use(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(
            "Replace the tumour of this session by the contour? "
            "The robot is held until an operator re-arms."
        ):
            logic.contour.use()
