"""The panel, made from the real .ui, under TEST DOUBLES of Qt's and Slicer's desktop side."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import SimpleNamespace

import pytest
import slicer

from app.fixture import MarginState
from app.scene import Preset
from tests.slicer_module.marginguard_module import CASE, FOLDER, PATIENCE_SPINS, UI, opened_case
from tests.slicer_module.marginguard_module import application as application
from tests.slicer_module.marginguard_module import desktop as desktop

BUTTONS = sorted(
    element.get("name")
    for element in ElementTree.parse(UI).getroot().iter("widget")
    if element.get("class") in ("QPushButton", "QToolButton", "QCheckBox", "QRadioButton")
)

BUDDY = ("EditLabel", "BoxLabel", "SelectorLabel", "SliderLabel")
"""How the labels of other widgets are named."""


class CommandsDouble:
    """TEST DOUBLE: takes the place of the logic's commands, and notes which one came."""

    def __init__(self, guard):
        self.guard = guard
        self.calls = []
        self.alarm = guard.alarm
        self.is_following = False

    def spin(self):
        return self.guard.spin(0.0)

    def margins(self):
        return self.guard.margins()

    def wants_alarm(self):
        return False

    def close(self):
        self.guard.close()

    def __getattr__(self, name):
        return lambda *arguments: self.calls.append((name, *arguments))


@pytest.fixture
def errors(monkeypatch):
    """What would have been told in windows."""
    told = []
    monkeypatch.setattr(slicer.util, "errorDisplay", lambda text, **_: told.append(text))
    return told


def in_slicer(monkeypatch, application):
    """``slicer.mrmlScene``, and of ``slicer.app`` a TEST DOUBLE."""
    monkeypatch.setattr(slicer, "mrmlScene", application.scene, raising=False)
    app = SimpleNamespace(applicationLogic=lambda: application.logic)
    monkeypatch.setattr(slicer, "app", app, raising=False)


@pytest.fixture
def panel(desktop, application, monkeypatch, errors):
    from tests.slicer_module.slicer_double import panel_parent

    in_slicer(monkeypatch, application)
    widget = desktop.MarginGuardWidget(panel_parent(FOLDER))
    widget.setup()
    widget._timer.stop()  # the tests spin themselves
    yield widget
    widget.cleanup()


@pytest.fixture
def pressed(panel):
    """``pressed(name)``: the commands that a click on the button gives."""
    commands = CommandsDouble(panel.logic.guard)
    panel.logic.guard = commands

    def press(name):
        commands.calls.clear()
        button = getattr(panel.ui, name)
        button.setEnabled(True)
        button.click()
        return list(commands.calls)

    yield press
    panel.logic.guard = commands.guard


WANTED = {
    "connectButton": [("connect", Path("live.yaml"))],
    "disconnectButton": [("disconnect",)],
    "registerButton": [("register_case", Path("some_case"))],
    "acceptButton": [("accept_registration",)],
    "setTumorButton": [("set_tumor", None, "Tumor")],
    "applyMarginsButton": [("set_margins", 1.5, 6.5)],
    "rearmButton": [("rearm",)],
    "anteriorViewButton": [("look", Preset.ANTERIOR)],
    "leftViewButton": [("look", Preset.LEFT)],
    "superiorViewButton": [("look", Preset.SUPERIOR)],
    "bullseyeButton": [("follow_tool", True)],
    "muteButton": [],  # a state of the alarm, tested below
    "loadButton": [("load_case", Path("replayed"))],
    "playButton": [("play",)],
    "pauseButton": [("pause",)],
    "stepButton": [("step",)],
}


def test_every_button_of_the_ui_is_pressed_below():
    assert sorted(WANTED) == BUTTONS


@pytest.mark.parametrize("name", BUTTONS)
def test_a_button_does_what_it_says(panel, pressed, name):
    panel.ui.segmentLineEdit.setText("Tumor")
    panel.ui.stopSpinBox.setValue(1.5)
    panel.ui.warnSpinBox.setValue(6.5)
    # Paths that do not exist: Slicer's parameter node does not hear of them.
    panel.ui.configPathLineEdit.setText("live.yaml")
    panel.ui.registrationPathLineEdit.setText("some_case")
    panel.ui.casePathLineEdit.setText("replayed")
    assert pressed(name) == WANTED[name]


def test_landmarks_are_registered_where_the_user_chose_them(panel, pressed, application):
    lists = [
        application.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", name)
        for name in ("fixed", "moving")
    ]
    panel.ui.registrationSourceComboBox.setCurrentIndex(1)
    panel.ui.fixedPointsSelector.setCurrentNode(lists[0])
    panel.ui.movingPointsSelector.setCurrentNode(lists[1])
    assert pressed("registerButton") == [("register_landmarks", *lists)]


def test_the_slider_seeks_and_the_settings_take_effect_at_once(panel, pressed, application):
    pressed("playButton")
    calls = panel.logic.guard.calls
    calls.clear()
    panel.ui.seekSlider.setProperty("maximum", 75.0)
    panel.ui.seekSlider.setValue(45.5)
    assert calls == [("seek", 45.5)]
    calls.clear()
    panel.ui.opacitySlider.setValue(0.7)
    panel.ui.rateSpinBox.setValue(2.0)
    node = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    panel.ui.patientTransformSelector.setCurrentNode(node)
    assert calls[-3:] == [("set_opacity", 0.7), ("set_rate", 2.0), ("set_patient_to_ras", node)]


def test_mute_is_a_state_of_the_button(panel):
    panel.ui.muteButton.click()
    assert panel.logic.guard.alarm.muted is True
    panel.ui.muteButton.click()
    assert panel.logic.guard.alarm.muted is False


def test_what_the_user_cannot_have_is_one_line_in_a_window(panel, errors):
    panel.ui.casePathLineEdit.setText("/no/such/case")
    panel.ui.loadButton.click()
    panel.ui.bullseyeButton.click()
    panel.ui.anteriorViewButton.click()
    panel.ui.registrationSourceComboBox.setCurrentIndex(1)
    panel.ui.registerButton.click()
    assert errors == [
        "/no/such/case: no such folder; expected a case",
        "nothing is shown yet: connect or load a case first",
        "nothing is shown yet: connect or load a case first",
        "there is no session: connect or load a case first",
    ]
    panel.spin()
    assert panel.ui.bullseyeButton.isChecked() is False


def test_a_panel_without_a_session_is_grey_and_offers_what_can_be_done(panel):
    panel.spin()
    assert panel.ui.bannerLabel.text() == "? UNKNOWN: nothing was tracked yet"
    assert "background-color: #808080" in panel.ui.bannerLabel.styleSheet()
    enabled = {name for name in BUTTONS if getattr(panel.ui, name).isEnabled()}
    views = {"anteriorViewButton", "leftViewButton", "superiorViewButton", "bullseyeButton"}
    assert enabled == {"connectButton", "registerButton", "muteButton", "loadButton", *views}


@pytest.mark.parametrize(
    "kind", ["vtkMRMLMarkupsFiducialNode", "vtkMRMLMarkupsClosedCurveNode", "vtkMRMLModelNode"]
)
def test_what_can_become_the_tumour_is_in_the_list(panel, pressed, application, kind):
    node = application.scene.AddNewNodeByClass(kind)
    panel.ui.tumorSelector.setCurrentNode(node)
    assert pressed("setTumorButton") == [("set_tumor", node, "")]


@pytest.mark.parametrize("broken", ["spin", "wants_alarm"])
def test_a_timer_that_fails_leaves_no_banner_as_it_was(panel, monkeypatch, broken):
    panel._show_banner(MarginState.NEGATIVE, "NEGATIVE: clear, 9.9 mm")

    def fail():
        raise ValueError("a bug")

    monkeypatch.setattr(panel.logic.guard, broken, fail)
    with pytest.raises(ValueError, match="a bug"):
        panel.spin()
    assert panel.ui.bannerLabel.text().startswith("? UNKNOWN")
    assert "background-color: #808080" in panel.ui.bannerLabel.styleSheet()


def test_a_replayed_case_is_shown(panel, desktop, monkeypatch):
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: opened_case())

    def until(wanted):
        for _ in range(PATIENCE_SPINS):
            panel.spin()
            if wanted():
                return
        raise AssertionError(panel.ui.messageLabel.text())

    ui = panel.ui
    ui.casePathLineEdit.setText(str(CASE))
    ui.loadButton.click()
    until(lambda: ui.playButton.isEnabled())
    assert ui.sessionLabel.text() == "simulated lumpectomy 1 (simulated): paused"
    assert ui.seekSlider.property("maximum") == pytest.approx(75.38)
    assert (ui.stopSpinBox.value(), ui.warnSpinBox.value()) == (1.0, 5.0)  # the case's
    ui.seekSlider.setValue(45.9)
    until(lambda: ui.bannerLabel.text().startswith("\N{MULTIPLICATION X} POSITIVE"))
    assert (
        f"background-color: {MarginState.POSITIVE.display.color_hex}" in ui.bannerLabel.styleSheet()
    )
    assert re.search(r", -\d\.\d mm$", ui.bannerLabel.text())
    assert "inside" in ui.reasonsLabel.text()
    assert ui.trackersLabel.text().count("valid") == 3
    assert desktop.qt.QApplication.beeps > 0
    beeps = desktop.qt.QApplication.beeps
    ui.stepButton.click()
    until(lambda: ui.seekSlider.property("value") > 45.91)
    ui.muteButton.click()
    panel.spin()
    assert desktop.qt.QApplication.beeps == beeps
    ui.playButton.click()
    until(lambda: ui.pauseButton.isEnabled())
    ui.pauseButton.click()
    until(lambda: not ui.pauseButton.isEnabled())


def test_the_banner_is_drawn_in_the_colour_of_the_state(panel):
    panel.spin()
    panel.parent.resize(430, 1000)
    banner = panel.ui.bannerLabel
    drawn = banner.grab().toImage().pixelColor(2, 2)
    assert (drawn.red(), drawn.green(), drawn.blue()) == (128, 128, 128)


def test_what_is_told_is_no_markup(panel):
    """The name of a node or a file may look like it: the rest of the line would be swallowed."""
    from PySide6.QtCore import Qt

    written = [each for each in vars(panel.ui).values() if hasattr(each, "textFormat")]
    told = [label for label in written if not label.objectName().endswith(BUDDY)]
    assert len(told) == 6
    assert {label.textFormat() for label in told} == {Qt.TextFormat.PlainText}


def test_the_settings_are_in_the_parameter_node_and_a_closed_scene_brings_new_ones(
    panel, application
):
    panel.ui.segmentLineEdit.setText("Tumor")
    node = panel.settings.parameterNode
    assert node.GetParameter("segment") == "Tumor"
    assert node.IsA("vtkMRMLScriptedModuleNode")
    panel.settings.warn_mm = 12.25
    assert panel.ui.warnSpinBox.value() == 12.25
    application.scene.Clear(0)
    assert (panel.settings.segment, panel.settings.warn_mm) == ("", 5.0)
    assert panel.ui.segmentLineEdit.text() == ""
    before = panel.settings
    application.scene.Clear(0)
    panel.ui.segmentLineEdit.setText("Other")
    assert panel.settings.segment == "Other"
    assert panel.settings is not before
    assert before._bindings == {}  # the widgets have left the settings of before


def test_a_slicer_without_marginguard_says_so_in_one_line(desktop, application, monkeypatch):
    from tests.slicer_module.slicer_double import panel_parent

    monkeypatch.setattr(
        desktop, "missing_requirement", lambda: "MarginGuard needs Python 3.11 or later"
    )
    widget = desktop.MarginGuardWidget(panel_parent(FOLDER))
    widget.setup()
    assert widget.layout.itemAt(0).widget().text() == "MarginGuard needs Python 3.11 or later"
    widget.cleanup()


def test_the_module_tells_slicer_what_it_is(desktop):
    class Parent:
        """TEST DOUBLE of what Slicer hands to a module."""

    parent = Parent()
    desktop.MarginGuard(parent)
    assert parent.title == "MarginGuard"
    assert "Not a medical device" in parent.helpText
    assert parent.acknowledgementText


def test_the_test_for_slicer_runs_here_too(desktop, application, monkeypatch):
    in_slicer(monkeypatch, application)
    monkeypatch.setattr("MarginGuardLib.logic.prepare_recorded", lambda folder: opened_case())
    desktop.MarginGuardTest().runTest()


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ("QPushButton", "ctkMenuButton", "widget class ctkMenuButton is not known"),
        ('name="tracking"', 'name="trackin"', "has no 'trackin'"),
        ("mrmlSceneChanged(vtkMRMLScene*)", "sceneChanged()", "sceneChanged\\(\\) is not known"),
        ("setMRMLScene(vtkMRMLScene*)", "setScene()", "setScene\\(\\) is not known"),
    ],
)
def test_the_double_refuses_what_the_real_widgets_do_not_have(
    desktop, tmp_path, was, becomes, message
):
    from tests.slicer_module.qt_double import UnknownInUiError

    text = UI.read_text()
    assert was in text
    changed = tmp_path / "changed.ui"
    changed.write_text(text.replace(was, becomes))
    with pytest.raises(UnknownInUiError, match=message):
        slicer.util.loadUI(str(changed))
