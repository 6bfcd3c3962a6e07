"""The widgets of the views: sides, bullseye, breach markers, state of the cautery."""

from collections.abc import Callable
from typing import Any

from app.scene import Preset

from .status import PanelStatus
from .view import PanelView


class ViewSection:
    """Connects the buttons, and shows which camera follows.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._ui = ui
        for button, command in (
            (ui.anteriorViewButton, lambda logic: logic.view.look_from(Preset.ANTERIOR)),
            (ui.leftViewButton, lambda logic: logic.view.look_from(Preset.LEFT)),
            (ui.rightViewButton, lambda logic: logic.view.look_from(Preset.RIGHT)),
            (ui.superiorViewButton, lambda logic: logic.view.look_from(Preset.SUPERIOR)),
            (
                ui.bullseyeButton,
                lambda logic: logic.view.follow_tool(ui.bullseyeButton.property("checked")),
            ),
            (
                ui.centreButton,
                lambda logic: logic.view.keep_centred(ui.centreButton.property("checked")),
            ),
            (ui.deleteMarkersButton, lambda logic: logic.view.delete_markers()),
        ):
            on_click(button, command)

    def show(self, view: PanelView, status: PanelStatus) -> None:
        """Show what ``view`` follows, and the cautery of ``status``."""
        self._ui.bullseyeButton.setChecked(view.follows_tool)
        self._ui.centreButton.setChecked(view.keeps_tumor)
        self._ui.deleteMarkersButton.setEnabled(status.has_session)
        self._ui.cauteryLabel.setText(status.cautery)
