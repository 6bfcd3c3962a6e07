"""The widgets of guided calibration and registration."""

from collections.abc import Callable
from functools import partial
from typing import Any

import slicer

from app.runtime import CalibrationKind, Coverage

from .coverage_picture import coverage_picture
from .guided import GuidedShown
from .table import fill_table
from .tool_choice import ToolChoice

_HELD = "The robot is held until an operator re-arms."
_HELD_AFTER = "After that of the cautery the robot is held until an operator re-arms."


class GuidedSection:
    """Connects the buttons, and shows the state of both recordings.

    ``on_click(button, command)`` has ``command(panel_logic)`` called at each click.
    """

    def __init__(self, ui: Any, on_click: Callable[[Any, Callable[[Any], object]], None]) -> None:
        self._ui = ui
        self._coverage: Coverage | None = None
        self._calibrated = ToolChoice(ui.calibratedToolComboBox)
        self._touching = ToolChoice(ui.touchToolComboBox)
        for button, command in (
            (ui.startPivotButton, partial(self._calibrate, CalibrationKind.PIVOT)),
            (ui.startSpinButton, partial(self._calibrate, CalibrationKind.SPIN)),
            (ui.stopCalibrationButton, lambda logic: logic.calibration().stop()),
            (ui.discardCalibrationButton, lambda logic: logic.calibration().discard()),
            (ui.useCalibrationButton, self._use_calibration),
            (ui.undoCalibrationButton, self._undo_calibration),
            (ui.startTouchButton, self._touch),
            (ui.stopTouchButton, lambda logic: logic.touch().stop()),
            (ui.discardTouchButton, lambda logic: logic.touch().discard()),
            (ui.removePointButton, self._remove_point),
            (ui.restorePointButton, lambda logic: logic.touch().restore()),
            (ui.useTouchButton, self._use_registration),
            (ui.undoRegistrationButton, self._undo_registration),
        ):
            on_click(button, command)

    def show(self, calibration: GuidedShown, registration: GuidedShown, stylus: str) -> None:
        """Show both recordings; ``stylus``: its tip in words, empty without one."""
        ui = self._ui
        self._calibrated.show(stylus)
        self._touching.show(stylus)
        ui.calibrationLabel.setText(calibration.text)
        if calibration.coverage is None and self._coverage is not None:
            ui.coverageLabel.clear()
        elif calibration.coverage is not None and calibration.coverage is not self._coverage:
            ui.coverageLabel.setPixmap(coverage_picture(calibration.coverage))
        self._coverage = calibration.coverage
        ui.startPivotButton.setEnabled(calibration.can_start)
        ui.startSpinButton.setEnabled(calibration.can_start)
        ui.stopCalibrationButton.setEnabled(calibration.is_recording)
        ui.discardCalibrationButton.setEnabled(calibration.can_discard)
        ui.useCalibrationButton.setEnabled(calibration.can_use)
        ui.undoCalibrationButton.setEnabled(calibration.can_undo)
        ui.touchLabel.setText(registration.text)
        fill_table(ui.touchTableWidget, registration.rows)
        ui.startTouchButton.setEnabled(registration.can_start)
        ui.stopTouchButton.setEnabled(registration.is_recording)
        ui.discardTouchButton.setEnabled(registration.can_discard)
        ui.removePointButton.setEnabled(bool(registration.rows))
        ui.restorePointButton.setEnabled(registration.can_restore)
        ui.useTouchButton.setEnabled(registration.can_use)
        ui.undoRegistrationButton.setEnabled(registration.can_undo)

    def _calibrate(self, kind: CalibrationKind, logic: Any) -> None:
        logic.calibration().start(kind, self._calibrated.tool)

    def _touch(self, logic: Any) -> None:
        logic.touch().start(self._touching.tool)

    def _use_calibration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use this calibration? {_HELD_AFTER}"):
            logic.calibration().use()

    def _undo_calibration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use the tip from before? {_HELD_AFTER}"):
            logic.calibration().undo()

    def _remove_point(self, logic: Any) -> None:
        logic.touch().remove(self._ui.touchTableWidget.currentRow())

    def _use_registration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use this registration of the robot? {_HELD}"):
            logic.touch().use()

    def _undo_registration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use the registration from before? {_HELD}"):
            logic.touch().undo()
