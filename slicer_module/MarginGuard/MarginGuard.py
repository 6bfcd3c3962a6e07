"""MarginGuard in desktop 3D Slicer: the panel, and the wiring between it and `MarginGuardLib`.

This file loads in any Slicer. It imports MarginGuard itself when the panel is created, and the
panel shows one line if that fails.
"""

import sys
from contextlib import contextmanager
from pathlib import Path

import ctk
import qt
import slicer
import vtk
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleTest,
    ScriptedLoadableModuleWidget,
)
from slicer.util import VTKObservationMixin

from MarginGuardLib.installation import missing_requirement

WATCHDOG_MS = 20
"""Longest time after which data that have become stale without a step are still shown."""


class MarginGuard(ScriptedLoadableModule):
    """Description of the module for Slicer."""

    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "MarginGuard"
        parent.categories = ["IGT"]
        parent.dependencies = ["Markups", "Segmentations", "Sequences"]
        parent.contributors = ["MarginGuard developers"]
        parent.helpText = (
            "Monitors the margin of a tumour: the tracked tool's signed distance, the state of the "
            "margin and the virtual fixture, live over ROS 2 or from a recorded case. Begin with "
            "<b>Replay</b> (a case folder) or <b>Connect</b> (a live.yaml). Grey means that the "
            "margin is not known; the reasons are below the banner. "
            "docs/slicer.md of MarginGuard describes this panel.<br><br>"
            "<b>Not a medical device</b>: a research tool that must not guide a treatment."
        )
        parent.acknowledgementText = (
            "Part of MarginGuard, Apache-2.0. The frames and node names are those of LumpNav and "
            "SlicerIGT; It is built on ROS 2, FCL and 3D Slicer."
        )


class MarginGuardWidget(ScriptedLoadableModuleWidget, VTKObservationMixin):
    """Connects the panel's buttons with `PanelLogic`, and shows its status in the panel."""

    def __init__(self, parent=None):
        ScriptedLoadableModuleWidget.__init__(self, parent)
        VTKObservationMixin.__init__(self)
        self.logic = None
        self.settings = None
        self._gui_tag = None
        self._margins = None
        self._patient_to_ras = None
        self._spinner = None
        self._banner = None
        self._view = None
        self._sections = None
        self._shown = None

    def setup(self):
        """Create the panel; without MarginGuard it is one line with the cause."""
        ScriptedLoadableModuleWidget.setup(self)
        reason = missing_requirement()
        if reason:
            self.layout.addWidget(qt.QLabel(reason))
            return
        ui_widget = slicer.util.loadUI(self.resourcePath("UI/MarginGuard.ui"))
        self.layout.addWidget(ui_widget)
        self.ui = slicer.util.childWidgetVariables(ui_widget)
        ui_widget.setMRMLScene(slicer.mrmlScene)
        self.logic = MarginGuardLogic(self._changed)
        self._connect_widgets()
        self._use_parameter_node()
        events = slicer.vtkMRMLScene
        self.addObserver(slicer.mrmlScene, events.StartCloseEvent, self.on_scene_closes)
        self.addObserver(slicer.mrmlScene, events.EndCloseEvent, self.on_scene_closed)
        from app.runtime import SWITCH_INTERVAL_S, QtSpinner

        sys.setswitchinterval(SWITCH_INTERVAL_S)
        self._spinner = QtSpinner(qt, self.spin, watchdog_ms=WATCHDOG_MS)
        self.refresh()

    def cleanup(self):
        """End spinner, session and jobs before the module is unloaded."""
        if self._spinner is not None:
            self._spinner.stop()
        if self.logic is None:
            return
        self._disconnect_parameter_node()
        self.removeObservers()
        self.logic.panel_logic.close()

    def spin(self):
        """Show the newest step, and the status where it is due. For each step, and by a watchdog.

        An error here is a bug: PythonQt logs it, and the banner turns to UNKNOWN.
        """
        self._show_newest(self.logic.panel_logic.spin)

    def refresh(self):
        """Show the newest step and the status at once, as after a command."""
        self._show_newest(self.logic.panel_logic.refresh)

    def _show_newest(self, newest):
        try:
            status = newest()
            if status is not None:
                self._show(status)
            if self.logic.panel_logic.alarm_due():
                qt.QApplication.beep()
            self._update_margin_settings()
        except Exception:
            from app.session import SHOWN_STATES

            text = "UNKNOWN: the panel has failed, see the log"
            self._show_banner(SHOWN_STATES["UNKNOWN"], text)
            raise

    def on_scene_closes(self, caller=None, event=None):
        """End the session before its nodes are removed, and disconnect the settings."""
        self._disconnect_parameter_node()
        self.logic.panel_logic.end_session()

    def on_scene_closed(self, caller=None, event=None):
        """Connect the settings of the new scene."""
        self._use_parameter_node()

    def on_settings(self, caller=None, event=None):
        """Apply the settings that take effect at once."""
        settings, logic = self.settings, self.logic.panel_logic
        with self._errors_displayed():
            logic.view.set_opacity(settings.opacity)
            logic.view.set_markers(settings.marker_spacing_mm, settings.marker_size_mm)
            logic.set_rate(settings.rate)
            logic.contour.set_options(
                settings.dilation_mm, settings.contour_error_mm, settings.hydromark_mm
            )
        patient_to_ras = settings.patient_to_ras
        if patient_to_ras is not self._patient_to_ras:  # a refused one is reported once
            self._patient_to_ras = patient_to_ras
            with self._errors_displayed():
                logic.view.set_patient_to_ras(patient_to_ras)

    def on_mute(self, checked=False):
        """Mute or unmute the alarm."""
        self.logic.panel_logic.alarm.muted = checked

    def on_seek(self, seconds):
        """Seek to the slider's position."""
        with self._errors_displayed():
            self.logic.panel_logic.seek(seconds)

    def on_approach(self, place):
        """Show the planned robot at the slider's position."""
        self.logic.panel_logic.plans.ghost.go_to(round(place))
        self.refresh()

    def _changed(self):
        """Wake Qt's thread; called in other threads."""
        if self._spinner is not None:
            self._spinner.wake()

    def _connect_widgets(self):
        ui = self.ui
        for edit in (ui.configPathLineEdit, ui.approachPathLineEdit, ui.needlePathLineEdit):
            edit.filters = ctk.ctkPathLineEdit.Files
        ui.casePathLineEdit.filters = ctk.ctkPathLineEdit.Dirs
        ui.registrationPathLineEdit.filters = ctk.ctkPathLineEdit.Dirs
        self._on_click(
            ui.connectButton, lambda logic: logic.connect(Path(ui.configPathLineEdit.currentPath))
        )
        self._on_click(ui.disconnectButton, lambda logic: logic.disconnect())
        self._on_click(ui.registerButton, self._register)
        self._on_click(ui.acceptButton, lambda logic: logic.accept_registration())
        self._on_click(
            ui.setTumorButton,
            lambda logic: logic.set_tumor(self.settings.tumor, self.settings.segment),
        )
        self._on_click(
            ui.applyMarginsButton,
            lambda logic: logic.set_margins(self.settings.stop_mm, self.settings.warn_mm),
        )
        self._on_click(ui.rearmButton, lambda logic: logic.rearm())
        self._on_click(ui.recordButton, lambda logic: logic.record(True))
        self._on_click(ui.stopRecordingButton, self._stop_recording)
        self._on_click(
            ui.loadButton, lambda logic: logic.load_case(Path(ui.casePathLineEdit.currentPath))
        )
        self._on_click(ui.playButton, lambda logic: logic.play())
        self._on_click(ui.pauseButton, lambda logic: logic.pause())
        self._on_click(ui.stepButton, lambda logic: logic.step())
        from MarginGuardLib.sections import Sections, ViewSection

        self._sections = Sections(ui, self._on_click)
        self._view = ViewSection(ui, self._on_click)
        ui.muteButton.clicked.connect(self.on_mute)
        ui.seekSlider.valueChanged.connect(self.on_seek)
        ui.approachSlider.valueChanged.connect(self.on_approach)

    def _on_click(self, button, command):
        """Call ``command(logic)`` at each click."""

        def clicked(checked=False):
            with self._errors_displayed():
                command(self.logic.panel_logic)

        button.clicked.connect(clicked)

    def _register(self, logic):
        """Compute a registration from the selected source."""
        from MarginGuardLib.settings import FROM_CASE

        if self.settings.registration_source == FROM_CASE:
            logic.register_case(Path(self.ui.registrationPathLineEdit.currentPath))
        else:
            logic.register_landmarks(self.settings.fixed_points, self.settings.moving_points)

    def _stop_recording(self, logic):
        """End the recording if the user confirms it."""
        if slicer.util.confirmOkCancelDisplay("End the recording of this session?"):
            logic.record(False)

    def _use_parameter_node(self):
        self.settings = self.logic.getParameterNode()
        # connectGui finds the same widgets, but does not return the tag for disconnectGui.
        named = ((each.property("SlicerParameterName"), each) for each in vars(self.ui).values())
        self._gui_tag = self.settings.connectParametersToGui(
            {name: widget for name, widget in named if name}
        )
        modified = vtk.vtkCommand.ModifiedEvent
        self.addObserver(self.settings.parameterNode, modified, self.on_settings)
        self._margins = None
        self.on_settings()

    def _disconnect_parameter_node(self):
        if self.settings is not None:
            self.settings.disconnectGui(self._gui_tag)
            self.removeObservers(self.on_settings)
        self.settings = None

    def _update_margin_settings(self):
        """Show margins that changed elsewhere, as by a ROS parameter."""
        margins = self.logic.panel_logic.margins()
        if margins is not None and margins != self._margins:
            self.settings.stop_mm, self.settings.warn_mm = margins.stop_mm, margins.warn_mm
        self._margins = margins

    def _show_banner(self, shown, text):
        """Show ``text`` after the symbol of ``shown``, on its colour; a hold has a dashed edge."""
        if (shown, text) == self._banner:
            return  # Qt would read the style sheet at each step
        self._banner = (shown, text)
        self.ui.bannerLabel.setText(f"{shown.symbol} {text}")
        self.ui.bannerLabel.setStyleSheet(
            f"background-color: {shown.ground_hex}; color: {shown.text_hex}; "
            f"border: {f'4px dashed {shown.text_hex}' if shown.key == 'HOLD' else 'none'}; "
            "font-size: 16px; font-weight: bold; padding: 8px;"
        )

    def _show(self, status):
        ui, events = self.ui, self.logic.panel_logic.events
        self._show_banner(status.shown, status.banner)
        self._show_position(status)
        shown = status, events.breach_rows(), events.note_rows()
        if shown == self._shown:
            return  # Qt would lay out the panel at each step
        self._shown = shown
        ui.reasonsLabel.setText(status.reasons)
        ui.messageLabel.setText(status.message)
        ui.requestLabel.setText(status.request)
        ui.recordingLabel.setText(status.recording)
        ui.sessionLabel.setText(status.session)
        ui.trackersLabel.setText(status.trackers)
        ui.workflowLabel.setText(status.workflow)
        ui.registrationLabel.setText(status.registration)
        for button in (ui.connectButton, ui.loadButton):
            button.setEnabled(not status.is_live)
        ui.disconnectButton.setEnabled(status.is_live)
        ui.acceptButton.setEnabled(status.can_accept)
        for button in (ui.setTumorButton, ui.applyMarginsButton, ui.rearmButton):
            button.setEnabled(status.has_session)
        ui.recordButton.setEnabled(status.is_live and not status.is_recording)
        ui.stopRecordingButton.setEnabled(status.is_recording)
        ui.directionsLabel.setText(status.directions)
        has_case = status.position_s is not None
        self._sections.show(status, events)
        ui.playButton.setEnabled(has_case and not status.is_playing)
        ui.pauseButton.setEnabled(status.is_playing)
        ui.stepButton.setEnabled(has_case and status.has_session)
        ui.seekSlider.setEnabled(has_case)

    def _show_position(self, status):
        """Show what a user may have moved meanwhile."""
        ui = self.ui
        self._view.show(self.logic.panel_logic.view, status)
        has_case = status.position_s is not None
        if has_case and not ui.seekSlider.underMouse():
            ui.seekSlider.blockSignals(True)
            ui.seekSlider.setProperty("maximum", status.duration_s)
            ui.seekSlider.setValue(status.position_s)
            ui.seekSlider.blockSignals(False)

    @contextmanager
    def _errors_displayed(self):
        """Within the context expected errors open a window; others propagate."""
        from app.geometry import MarginGuardError

        try:
            yield
        except (MarginGuardError, OSError) as error:
            slicer.util.errorDisplay(" ".join(str(error).split()))


class MarginGuardLogic(ScriptedLoadableModuleLogic):
    """The logic for scripts: `panel_logic` has the commands, the parameter node the settings.

    ``changed()`` is called in any thread when `panel_logic` has something to show.
    """

    def __init__(self, changed=lambda: None):
        ScriptedLoadableModuleLogic.__init__(self)
        from MarginGuardLib.logic import PanelLogic

        self.panel_logic = PanelLogic(
            slicer.mrmlScene, slicer.app.applicationLogic(), changed=changed
        )

    def getParameterNode(self):
        """Return the typed settings."""
        from MarginGuardLib.settings import Settings

        return Settings(super().getParameterNode())


class MarginGuardTest(ScriptedLoadableModuleTest):
    """Replays a case; run inside Slicer (Reload and Test, or ``slicer.util.runTests``)."""

    def setUp(self):
        """Clear the scene."""
        slicer.mrmlScene.Clear()

    def runTest(self):
        """Run every test."""
        self.setUp()
        self.test_tumour_is_red_in_breach_and_grey_in_dropout()

    def test_tumour_is_red_in_breach_and_grey_in_dropout(self):
        """Check the tumour's colour at three times of the shipped case."""
        from app.case import open_case
        from app.files.paths import shipped
        from app.fixture import MarginState

        self.delayDisplay("Replaying the recorded case")
        logic = MarginGuardLogic().panel_logic
        try:
            case = shipped("data", "recorded_case")
            expected = open_case(case).expected()
            breach = expected.breaches.intervals[0]
            invalid = [each for each in expected.dropouts if each.kind == "invalid"]
            lost = max(invalid, key=lambda each: each.end_s - each.start_s)
            logic.load_case(case)
            self._until(logic, 0.0)
            for seconds, state in (
                (0.5 * (breach.start_s + breach.end_s), MarginState.POSITIVE),
                (0.5 * (lost.start_s + lost.end_s), MarginState.UNKNOWN),
                (1.0, MarginState.NEGATIVE),
            ):
                logic.seek(seconds)
                self._until(logic, seconds)
                tumor = slicer.mrmlScene.GetFirstNodeByName("Tumor")
                self.assertEqual(tumor.GetDisplayNode().GetColor(), state.color)
        finally:
            logic.close()
        self.assertIsNone(slicer.mrmlScene.GetFirstNodeByName("Tumor"))
        self.delayDisplay("Test passed")

    def _until(self, logic, seconds):
        """Spin until the frame at ``seconds`` is shown, at most a minute."""
        import time

        end_s = time.monotonic() + 60.0
        while time.monotonic() < end_s:
            status = logic.refresh(0.02)  # other threads run while it waits
            shown_s = status.position_s
            if shown_s is not None and 0.0 <= shown_s - seconds < 0.1:
                return
        self.fail(f"{seconds} s was not shown: {status}")
