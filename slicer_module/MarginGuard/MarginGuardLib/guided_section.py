"""The widgets of guided calibration and registration."""

from functools import partial
from typing import Any

import slicer

from app.geometry import InputError
from app.runtime import GUARDED_TOOL
from app.workflow import CalibrationKind, Coverage, GuidedShown

from .status import PanelStatus
from .widgets import OnClick, ToolChoice, coverage_picture, fill_table, show_picture

_HELD = "The robot is held until an operator re-arms."
_HELD_AFTER = f"After that of the {GUARDED_TOOL} the robot is held until an operator re-arms."


class GuidedSection:
    """Connects the buttons, and shows the state of both recordings."""

    def __init__(self, ui: Any, on_click: OnClick) -> None:
        self._ui = ui
        self._coverage: Coverage | None = None
        self._calibration = self._touch = GuidedShown()
        """Contents as shown: a command names the revision that its operator has seen."""
        self._calibrated = ToolChoice(ui.calibratedToolComboBox)
        self._touching = ToolChoice(ui.touchToolComboBox)
        on_click(ui.startPivotButton, partial(self._calibrate, CalibrationKind.PIVOT))
        on_click(ui.startSpinButton, partial(self._calibrate, CalibrationKind.SPIN))
        on_click(
            ui.stopCalibrationButton,
            lambda logic: logic.calibration().stop(self._calibration.revision),
        )
        on_click(
            ui.discardCalibrationButton,
            lambda logic: logic.calibration().discard(self._calibration.revision),
        )
        on_click(ui.useCalibrationButton, self._use_calibration)
        on_click(ui.undoCalibrationButton, self._undo_calibration)
        on_click(ui.startTouchButton, self._start_touch)
        on_click(ui.stopTouchButton, lambda logic: logic.touch().stop(self._touch.revision))
        on_click(ui.discardTouchButton, lambda logic: logic.touch().discard(self._touch.revision))
        on_click(ui.removePointButton, self._remove_point)
        on_click(ui.restorePointButton, lambda logic: logic.touch().restore(self._touch.revision))
        on_click(ui.useTouchButton, self._use_registration)
        on_click(ui.undoRegistrationButton, self._undo_registration)

    def show(self, status: PanelStatus) -> None:
        """Show both recordings, and the tools that may be chosen."""
        ui, calibration, touch = self._ui, status.calibration, status.touch
        self._calibration, self._touch = calibration, touch
        self._calibrated.show(status.tools)
        self._touching.show(status.tools)
        ui.calibrationLabel.setText(calibration.text)
        if status.coverage is not self._coverage:
            self._coverage = coverage = status.coverage
            show_picture(ui.coverageLabel, None if coverage is None else coverage_picture(coverage))
        ui.startPivotButton.setEnabled(calibration.can_start)
        ui.startSpinButton.setEnabled(calibration.can_start)
        ui.stopCalibrationButton.setEnabled(calibration.is_recording)
        ui.discardCalibrationButton.setEnabled(calibration.can_discard)
        ui.useCalibrationButton.setEnabled(calibration.can_use)
        ui.undoCalibrationButton.setEnabled(calibration.can_undo)
        ui.touchLabel.setText(touch.text)
        rows = ((str(each.number), each.residual, each.left_out) for each in touch.points)
        fill_table(ui.touchTableWidget, tuple(rows))
        ui.startTouchButton.setEnabled(touch.can_start)
        ui.stopTouchButton.setEnabled(touch.is_recording)
        ui.discardTouchButton.setEnabled(touch.can_discard)
        ui.removePointButton.setEnabled(bool(touch.points))
        ui.restorePointButton.setEnabled(touch.can_restore)
        ui.useTouchButton.setEnabled(touch.can_use)
        ui.undoRegistrationButton.setEnabled(touch.can_undo)

    def _calibrate(self, kind: CalibrationKind, logic: Any) -> None:
        logic.calibration().start(self._calibration.revision, kind, self._calibrated.tool)

    def _start_touch(self, logic: Any) -> None:
        logic.touch().start(self._touch.revision, self._touching.tool)

    def _use_calibration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use this calibration? {_HELD_AFTER}"):
            logic.calibration().accept(self._calibration.revision)

    def _undo_calibration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use the tip from before? {_HELD_AFTER}"):
            logic.calibration().undo(self._calibration.revision)

    def _remove_point(self, logic: Any) -> None:
        row, points = self._ui.touchTableWidget.currentRow(), self._touch.points
        if not 0 <= row < len(points):
            raise InputError("registration: no point is selected; expected a row of the table")
        logic.touch().remove(self._touch.revision, int(points[row].id))

    def _use_registration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use this registration of the robot? {_HELD}"):
            logic.touch().accept(self._touch.revision)

    def _undo_registration(self, logic: Any) -> None:
        if slicer.util.confirmOkCancelDisplay(f"Use the registration from before? {_HELD}"):
            logic.touch().undo(self._touch.revision)
