"""The widgets of the ultrasound image."""

from collections.abc import Callable
from typing import Any

import slicer

from .ultrasound import UltrasoundShown


class UltrasoundSection:
    """Connects the buttons, and shows the image's state and the depths.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._ui = ui
        self._shown = UltrasoundShown()
        self._depths: tuple[float, ...] | None = None
        for button, command in (
            (
                ui.freezeImageButton,
                lambda logic: logic.ultrasound.freeze(ui.freezeImageButton.property("checked")),
            ),
            (
                ui.followImageButton,
                lambda logic: logic.ultrasound.follow(ui.followImageButton.property("checked")),
            ),
            (ui.useDepthButton, self._use_depth),
        ):
            on_click(button, command)

    def show(self, shown: UltrasoundShown) -> None:
        """Show ``shown``."""
        ui, self._shown = self._ui, shown
        ui.imageLabel.setText(shown.text)
        ui.freezeImageButton.setEnabled(shown.has_images)
        ui.freezeImageButton.setChecked(shown.is_frozen)
        ui.followImageButton.setEnabled(shown.has_images)
        ui.followImageButton.setChecked(shown.follows)
        used = "one" if shown.depth_mm is None else f"{shown.depth_mm:g} mm"
        ui.depthLabel.setText(used if shown.has_images else "")
        if shown.depths_mm != self._depths:
            self._depths = shown.depths_mm
            ui.depthComboBox.clear()
            for depth_mm in shown.depths_mm:
                ui.depthComboBox.addItem(f"{depth_mm:g} mm")
        can_choose = shown.can_choose and bool(shown.depths_mm)
        ui.depthComboBox.setEnabled(can_choose)
        ui.useDepthButton.setEnabled(can_choose)

    def _use_depth(self, logic: Any) -> None:
        index = self._ui.depthComboBox.property("currentIndex")
        if not 0 <= index < len(self._shown.depths_mm):
            return
        depth_mm = self._shown.depths_mm[index]
        if slicer.util.confirmOkCancelDisplay(
            f"Use the depth {depth_mm:g} mm? Images that are stamped from now on are placed by its "
            "calibration. The ultrasound machine has to be at this depth."
        ):
            logic.ultrasound.choose_depth(depth_mm)
