"""MarginGuard in desktop 3D Slicer: the panel, and the wiring between it and `MarginGuardLib`.

This file loads in any Slicer. MarginGuard's own packages are imported when the panel is created, so
that a Slicer without them shows one line instead.
"""

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

SPIN_MS = 20


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
            "margin is not known: the reasons are below the banner. "
            "docs/slicer.md of MarginGuard describes this panel.<br><br>"
            "<b>Not a medical device</b>: a research tool that must not guide a treatment."
        )
        parent.acknowledgementText = (
            "Part of MarginGuard, Apache-2.0. The frames and node names are those of LumpNav and "
            "SlicerIGT; it builds on ROS 2, FCL and 3D Slicer."
        )


class MarginGuardWidget(ScriptedLoadableModuleWidget, VTKObservationMixin):
    """Connects the panel's widgets to the logic, and shows the logic's status."""

    def __init__(self, parent=None):
        ScriptedLoadableModuleWidget.__init__(self, parent)
        VTKObservationMixin.__init__(self)
        self.logic = None
        self.settings = None
        self._gui_tag = None
        self._margins = None
        self._patient_to_ras = None
        self._timer = None

    def setup(self):
        """Create the panel, or one line with the reason where MarginGuard is missing."""
        ScriptedLoadableModuleWidget.setup(self)
        reason = missing_requirement()
        if reason:
            self.layout.addWidget(qt.QLabel(reason))
            return
        panel = slicer.util.loadUI(self.resourcePath("UI/MarginGuard.ui"))
        self.layout.addWidget(panel)
        self.ui = slicer.util.childWidgetVariables(panel)
        panel.setMRMLScene(slicer.mrmlScene)
        self.logic = MarginGuardLogic()
        self._connect_widgets()
        self._use_parameter_node()
        events = slicer.vtkMRMLScene
        self.addObserver(slicer.mrmlScene, events.StartCloseEvent, self.on_scene_closes)
        self.addObserver(slicer.mrmlScene, events.EndCloseEvent, self.on_scene_closed)
        self._timer = qt.QTimer()
        self._timer.setInterval(SPIN_MS)
        self._timer.timeout.connect(self.spin)
        self._timer.start()
        self.spin()

    def cleanup(self):
        """Stop the timer and the session when the module is unloaded."""
        if self._timer is not None:
            self._timer.stop()
        if self.logic is None:
            return
        self._leave_parameter_node()
        self.removeObservers()
        self.logic.guard.close()

    def spin(self):
        """Show the newest step and the status; called by the timer.

        An error in here is a bug: PythonQt logs it, and the banner must not stay as it was.
        """
        try:
            self._show(self.logic.guard.spin())
            if self.logic.guard.wants_alarm():
                qt.QApplication.beep()
            self._take_margins()
        except Exception:
            from app.fixture import MarginState

            self._show_banner(MarginState.UNKNOWN, "UNKNOWN: the panel has failed, see the log")
            raise

    def on_scene_closes(self, caller=None, event=None):
        """End the session before its nodes are removed, and disconnect the settings."""
        self._leave_parameter_node()
        self.logic.guard.forget_scene()

    def on_scene_closed(self, caller=None, event=None):
        """Use new settings, because those of the closed scene are gone."""
        self._use_parameter_node()

    def on_settings(self, caller=None, event=None):
        """Apply the settings that take effect at once."""
        with self._errors_shown():
            self.logic.guard.set_opacity(self.settings.opacity)
            self.logic.guard.set_rate(self.settings.rate)
        patient_to_ras = self.settings.patient_to_ras
        if patient_to_ras is not self._patient_to_ras:  # report a refused one once
            self._patient_to_ras = patient_to_ras
            with self._errors_shown():
                self.logic.guard.set_patient_to_ras(patient_to_ras)

    def on_bullseye(self, checked=False):
        """Let the camera follow the tool, or stop following."""
        with self._errors_shown():
            self.logic.guard.follow_tool(checked)

    def on_mute(self, checked=False):
        """Mute or unmute the alarm."""
        self.logic.guard.alarm.muted = checked

    def on_seek(self, seconds):
        """Seek to the position of the slider."""
        with self._errors_shown():
            self.logic.guard.seek(seconds)

    def _connect_widgets(self):
        from app.scene import Preset

        ui = self.ui
        ui.configPathLineEdit.filters = ctk.ctkPathLineEdit.Files
        ui.casePathLineEdit.filters = ctk.ctkPathLineEdit.Dirs
        ui.registrationPathLineEdit.filters = ctk.ctkPathLineEdit.Dirs
        for button, command in (
            (
                ui.connectButton,
                lambda guard: guard.connect(Path(ui.configPathLineEdit.currentPath)),
            ),
            (ui.disconnectButton, lambda guard: guard.disconnect()),
            (ui.registerButton, self._register),
            (ui.acceptButton, lambda guard: guard.accept_registration()),
            (
                ui.setTumorButton,
                lambda guard: guard.set_tumor(self.settings.tumor, self.settings.segment),
            ),
            (
                ui.applyMarginsButton,
                lambda guard: guard.set_margins(self.settings.stop_mm, self.settings.warn_mm),
            ),
            (ui.rearmButton, lambda guard: guard.rearm()),
            (ui.anteriorViewButton, lambda guard: guard.look(Preset.ANTERIOR)),
            (ui.leftViewButton, lambda guard: guard.look(Preset.LEFT)),
            (ui.superiorViewButton, lambda guard: guard.look(Preset.SUPERIOR)),
            (ui.loadButton, lambda guard: guard.load_case(Path(ui.casePathLineEdit.currentPath))),
            (ui.playButton, lambda guard: guard.play()),
            (ui.pauseButton, lambda guard: guard.pause()),
            (ui.stepButton, lambda guard: guard.step()),
        ):
            self._on_click(button, command)
        ui.bullseyeButton.clicked.connect(self.on_bullseye)
        ui.muteButton.clicked.connect(self.on_mute)
        ui.seekSlider.valueChanged.connect(self.on_seek)

    def _on_click(self, button, command):
        """Call ``command(guard)`` at each click and show its error in a window."""

        def clicked(checked=False):
            with self._errors_shown():
                command(self.logic.guard)

        button.clicked.connect(clicked)

    def _register(self, guard):
        """Compute a registration from the source that the user selected."""
        from MarginGuardLib.settings import FROM_CASE

        if self.settings.registration_source == FROM_CASE:
            guard.register_case(Path(self.ui.registrationPathLineEdit.currentPath))
        else:
            guard.register_landmarks(self.settings.fixed_points, self.settings.moving_points)

    def _use_parameter_node(self):
        self.settings = self.logic.getParameterNode()
        # connectGui connects the same widgets, but does not return the tag for disconnectGui.
        named = ((each.property("SlicerParameterName"), each) for each in vars(self.ui).values())
        self._gui_tag = self.settings.connectParametersToGui(
            {name: widget for name, widget in named if name}
        )
        modified = vtk.vtkCommand.ModifiedEvent
        self.addObserver(self.settings.parameterNode, modified, self.on_settings)
        self._margins = None
        self.on_settings()

    def _leave_parameter_node(self):
        if self.settings is not None:
            self.settings.disconnectGui(self._gui_tag)
            self.removeObservers(self.on_settings)
        self.settings = None

    def _take_margins(self):
        margins = self.logic.guard.margins()
        if margins is not None and margins != self._margins:
            self.settings.stop_mm, self.settings.warn_mm = margins.stop_mm, margins.warn_mm
        self._margins = margins

    def _show_banner(self, state, text):
        """Show ``text`` after the symbol of ``state``, on its colour."""
        display = state.display
        self.ui.bannerLabel.setText(f"{display.symbol} {text}")
        self.ui.bannerLabel.setStyleSheet(
            f"background-color: {display.color_hex}; color: {display.text_color_hex}; "
            "font-size: 16px; font-weight: bold; padding: 8px;"
        )

    def _show(self, status):
        ui = self.ui
        self._show_banner(status.state, status.banner)
        ui.reasonsLabel.setText(status.reasons)
        ui.messageLabel.setText(status.message)
        ui.sessionLabel.setText(status.session)
        ui.trackersLabel.setText(status.trackers)
        ui.registrationLabel.setText(status.registration)
        for button in (ui.connectButton, ui.loadButton):
            button.setEnabled(not status.is_live)
        ui.disconnectButton.setEnabled(status.is_live)
        ui.acceptButton.setEnabled(status.can_accept)
        for button in (ui.setTumorButton, ui.applyMarginsButton, ui.rearmButton):
            button.setEnabled(status.has_session)
        has_case = status.position_s is not None
        ui.playButton.setEnabled(has_case and not status.is_playing)
        ui.pauseButton.setEnabled(status.is_playing)
        ui.stepButton.setEnabled(has_case and status.has_session)
        ui.bullseyeButton.setChecked(self.logic.guard.is_following)
        ui.seekSlider.setEnabled(has_case)
        if has_case and not ui.seekSlider.underMouse():
            ui.seekSlider.blockSignals(True)
            ui.seekSlider.setProperty("maximum", status.duration_s)
            ui.seekSlider.setValue(status.position_s)
            ui.seekSlider.blockSignals(False)

    @contextmanager
    def _errors_shown(self):
        """Show an expected error in a window; let unexpected ones propagate."""
        from app.geometry import MarginGuardError

        try:
            yield
        except (MarginGuardError, OSError) as error:
            slicer.util.errorDisplay(" ".join(str(error).split()))


class MarginGuardLogic(ScriptedLoadableModuleLogic):
    """The logic for scripts: ``guard`` does the work, the parameter node holds the settings."""

    def __init__(self):
        ScriptedLoadableModuleLogic.__init__(self)
        from MarginGuardLib.logic import PanelLogic

        self.guard = PanelLogic(slicer.mrmlScene, slicer.app.applicationLogic())

    def getParameterNode(self):
        """The settings, typed."""
        from MarginGuardLib.settings import Settings

        return Settings(super().getParameterNode())


class MarginGuardTest(ScriptedLoadableModuleTest):
    """Run inside Slicer (Reload and Test, or ``slicer.util.runTests``): replay a case."""

    def setUp(self):
        """Start with an empty scene."""
        slicer.mrmlScene.Clear()

    def runTest(self):
        """Run every test."""
        self.setUp()
        self.test_the_tumour_is_red_in_a_breach_and_grey_in_a_dropout()

    def test_the_tumour_is_red_in_a_breach_and_grey_in_a_dropout(self):
        """Colour of the tumour node at three times of the recorded case."""
        import app
        from app.fixture import MarginState

        self.delayDisplay("Replaying the recorded case")
        guard = MarginGuardLogic().guard
        try:
            guard.load_case(Path(app.__file__).parents[1] / "data" / "recorded_case")
            self._until(guard, 0.0)
            for seconds, state in (
                (45.9, MarginState.POSITIVE),
                (22.3, MarginState.UNKNOWN),
                (5.0, MarginState.NEGATIVE),
            ):
                guard.seek(seconds)
                self._until(guard, seconds)
                tumor = slicer.mrmlScene.GetFirstNodeByName("Tumor")
                self.assertEqual(tumor.GetDisplayNode().GetColor(), state.color)
        finally:
            guard.close()
        self.assertIsNone(slicer.mrmlScene.GetFirstNodeByName("Tumor"))
        self.delayDisplay("Test passed")

    def _until(self, guard, seconds):
        """Spin until the frame at ``seconds`` is shown, at most one minute."""
        import time

        end_s = time.monotonic() + 60.0
        while time.monotonic() < end_s:
            status = guard.spin()
            shown_s = status.position_s
            if shown_s is not None and 0.0 <= shown_s - seconds < 0.1:
                return
        self.fail(f"{seconds} s was not shown: {status}")
