"""The panel from its real .ui, with TEST DOUBLES of Slicer's desktop widgets."""

import re
import xml.etree.ElementTree as ElementTree
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import slicer

from app.fixture import MarginState
from app.geometry import Transform
from app.runtime import GUARDED_TOOL, ShownItem
from app.scene import Preset, SceneApplication
from app.session import SHOWN_STATES
from app.workflow import CalibrationKind
from tests.shipped_case import DEEP, middle_s
from tests.slicer_module.conftest import open_panel
from tests.slicer_module.marginguard_module import CASE, FOLDER, UI, frame_times_s, in_slicer
from tests.waiting import wait_until

from MarginGuardLib.ultrasound import UltrasoundShown  # isort: skip

pytestmark = pytest.mark.slow

BUTTONS = sorted(
    element.get("name")
    for element in ElementTree.parse(UI).getroot().iter("widget")
    if element.get("class") in ("QPushButton", "QToolButton", "QCheckBox", "QRadioButton")
)

BUDDY = ("EditLabel", "BoxLabel", "SelectorLabel", "SliderLabel")
"""Name endings of labels that belong to other widgets."""


class RecordedPart:
    """TEST DOUBLE of a part of `PanelLogic`: records ``part.name`` of each command."""

    follows_tool = keeps_tumor = False

    def __init__(self, part, calls):
        self._part, self._calls = part, calls

    def __call__(self, *arguments):
        """The part is a command itself, or `PanelLogic` returns it."""
        if self._part not in ("calibration", "touch"):
            self._calls.append((self._part, *arguments))
        return self

    def __getattr__(self, name):
        return RecordedPart(f"{self._part}.{name}", self._calls)


class CommandsDouble:
    """TEST DOUBLE of `PanelLogic` that records the commands."""

    def __init__(self, panel_logic):
        self.panel_logic, self.calls = panel_logic, []
        self.alarm, self.spin = panel_logic.alarm, panel_logic.spin
        self.refresh = panel_logic.refresh
        self.margins, self.close = panel_logic.margins, panel_logic.close

    def alarm_due(self):
        return False

    def __getattr__(self, name):
        return RecordedPart(name, self.calls)


@pytest.fixture(autouse=True)
def confirmed(monkeypatch):
    """Questions of the windows, each of which is answered with OK."""
    questions = []
    monkeypatch.setattr(
        slicer.util,
        "confirmOkCancelDisplay",
        lambda text: questions.append(text) or True,
        raising=False,
    )
    return questions


def press(panel, name):
    """Click the button and return the commands that it caused."""
    button, calls = getattr(panel.ui, name), panel.logic.panel_logic.calls
    button.setEnabled(True)
    button.setChecked(False)
    calls.clear()
    button.click()
    return list(calls)


@contextmanager
def recording_commands(panel):
    """A `CommandsDouble` in place of the panel's logic."""
    logic = panel.logic.panel_logic
    panel.logic.panel_logic = CommandsDouble(logic)
    yield panel
    panel.logic.panel_logic = logic


@pytest.fixture(scope="module")
def one_panel(desktop):
    """One panel for all buttons."""
    application = SceneApplication(slicer.vtkMRMLScene())
    with (
        pytest.MonkeyPatch.context() as patch,
        open_panel(desktop, application, patch) as panel,
        recording_commands(panel),
    ):
        yield panel


@pytest.fixture
def pressed(panel):
    """``pressed(name)`` clicks the button and returns the commands that it caused."""
    with recording_commands(panel):
        yield partial(press, panel)


EXPECTED_CALLS = {
    "connectButton": [("connect", Path("live.yaml"))],
    "disconnectButton": [("disconnect",)],
    "startPivotButton": [("calibration.start", 0, CalibrationKind.PIVOT, GUARDED_TOOL)],
    "startSpinButton": [("calibration.start", 0, CalibrationKind.SPIN, GUARDED_TOOL)],
    "stopCalibrationButton": [("calibration.stop", 0)],
    "discardCalibrationButton": [("calibration.discard", 0)],
    "useCalibrationButton": [("calibration.accept", 0)],
    "undoCalibrationButton": [("calibration.undo", 0)],
    "startTouchButton": [("touch.start", 0, GUARDED_TOOL)],
    "stopTouchButton": [("touch.stop", 0)],
    "discardTouchButton": [("touch.discard", 0)],
    "removePointButton": [],
    "restorePointButton": [("touch.restore", 0)],
    "useTouchButton": [("touch.accept", 0)],
    "undoRegistrationButton": [("touch.undo", 0)],
    "registerButton": [("register_case", Path("some_case"))],
    "acceptButton": [("accept_registration",)],
    "setTumorButton": [("set_tumor", None, "Tumor")],
    "placePointsButton": [("contour.place",)],
    "tipPointButton": [("contour.add_tip", GUARDED_TOOL)],
    "undoPointButton": [("contour.undo",)],
    "eraseAtTipButton": [("contour.erase_at_tip", 2.0)],
    "deletePointsButton": [("contour.delete_all",)],
    "useContourButton": [("contour.use",)],
    "applyMarginsButton": [("set_margins", 1.5, 6.5)],
    "rearmButton": [("rearm",)],
    "switchStructureButton": [],  # there are no structures; the choice is tested below
    "recordButton": [("record", True)],
    "stopRecordingButton": [("record", False)],
    "anteriorViewButton": [("view.look_from", Preset.ANTERIOR)],
    "leftViewButton": [("view.look_from", Preset.LEFT)],
    "superiorViewButton": [("view.look_from", Preset.SUPERIOR)],
    "rightViewButton": [("view.look_from", Preset.RIGHT)],
    "centreButton": [("view.keep_centred", True)],
    "bullseyeButton": [("view.follow_tool", True)],
    "followImageButton": [("ultrasound.follow", True)],
    "freezeImageButton": [("ultrasound.freeze", True)],
    "useDepthButton": [],  # there are no depths; the choice is tested below
    "showApproachButton": [("plans.show_approach", Path("approach.json"))],
    "removeApproachButton": [("plans.ghost.remove",)],
    "beginGoalButton": [("plans.goal.begin", 5.0)],
    "planGoalButton": [("plans.goal.plan",)],
    "endGoalButton": [("plans.goal.end",)],
    "showNeedleButton": [("plans.show_needle", Path("needle.json"))],
    "removeNeedleButton": [("plans.needle.remove",)],
    "useCorridorButton": [("plans.needle.choose", -1)],
    "deleteMarkersButton": [("view.delete_markers",)],
    "muteButton": [],  # a state of the alarm, tested below
    "goToBreachButton": [("events.go_to_breach", -1)],
    "goToNoteButton": [("events.go_to_note", -1)],
    "addNoteButton": [("events.add_note", "a note")],
    "eventsTableButton": [("events.to_table",)],
    "loadButton": [("load_case", Path("replayed"))],
    "playButton": [("play",)],
    "pauseButton": [("pause",)],
    "stepButton": [("step",)],
}


def test_expected_calls_cover_every_button_of_ui():
    assert sorted(EXPECTED_CALLS) == BUTTONS


@pytest.mark.parametrize("name", BUTTONS)
def test_button_calls_its_command(one_panel, errors, name):
    ui = one_panel.ui
    ui.segmentLineEdit.setText("Tumor")
    ui.noteLineEdit.setText("a note")
    ui.stopSpinBox.setValue(1.5)
    ui.warnSpinBox.setValue(6.5)
    # Slicer's parameter node does not store paths that do not exist.
    ui.configPathLineEdit.setText("live.yaml")
    ui.registrationPathLineEdit.setText("some_case")
    ui.casePathLineEdit.setText("replayed")
    ui.approachPathLineEdit.setText("approach.json")
    ui.needlePathLineEdit.setText("needle.json")
    assert press(one_panel, name) == EXPECTED_CALLS[name]
    unselected = "registration: no point is selected; expected a row of the table"
    assert errors == ([unselected] if name == "removePointButton" else [])


def test_chosen_tool_is_calibrated_and_touches_the_points(panel, pressed):
    for name in ("calibratedToolComboBox", "touchToolComboBox", "tipToolComboBox"):
        getattr(panel.ui, name).setCurrentIndex(1)
    for button in ("startPivotButton", "startSpinButton", "startTouchButton", "tipPointButton"):
        (call,) = pressed(button)
        assert call == (*EXPECTED_CALLS[button][0][:-1], "stylus")


def test_row_of_a_rod_shows_its_length_and_changes_it(panel):
    label, buttons = panel._sections._items._rows["needle"]
    assert label.text() == "no needle" and not any(each.isEnabled() for each in buttons)
    edge = Transform("needle", "needle_tip", np.eye(3), [0.0, 0.0, 60.0])
    panel._sections._items.show((ShownItem("needle", "needle", 60.0, edge),), is_live=True)
    assert label.text() == "60" and all(each.isEnabled() for each in buttons)
    assert [each.text() for each in buttons] == ["-5", "-1", "+1", "+5"]
    with recording_commands(panel):
        for button in buttons:
            button.click()
        calls = panel.logic.panel_logic.calls
    assert calls == [("items.lengthen", "needle", by_mm) for by_mm in (-5.0, -1.0, 1.0, 5.0)]


HELD = "robot is held until an operator re-arms."


@pytest.mark.parametrize(
    ("name", "question"),
    [
        ("stopRecordingButton", "End the recording of this session?"),
        ("useCalibrationButton", f"Use this calibration? After that of the cautery the {HELD}"),
        ("undoCalibrationButton", f"Use the tip from before? After that of the cautery the {HELD}"),
        ("useTouchButton", f"Use this registration of the robot? The {HELD}"),
        ("undoRegistrationButton", f"Use the registration from before? The {HELD}"),
        ("deletePointsButton", "Delete all points of the contour?"),
        ("useContourButton", f"Replace the tumour of this session by the contour? The {HELD}"),
    ],
)
def test_button_calls_its_command_after_a_question_only(
    one_panel, confirmed, monkeypatch, name, question
):
    assert press(one_panel, name) == EXPECTED_CALLS[name]
    assert confirmed == [question]
    monkeypatch.setattr(slicer.util, "confirmOkCancelDisplay", lambda text: False)
    assert press(one_panel, name) == []


def test_depth_is_chosen_among_the_listed_ones_after_a_question(
    panel, pressed, confirmed, monkeypatch
):
    shown = UltrasoundShown("image 3, depth 40 mm", True, (40.0, 60.0), 40.0, can_choose=True)
    panel._sections._ultrasound.show(shown)
    assert (panel.ui.imageLabel.text(), panel.ui.depthLabel.text()) == (shown.text, "40 mm")
    panel.ui.depthComboBox.setCurrentIndex(1)
    assert pressed("useDepthButton") == [("ultrasound.choose_depth", 60.0)]
    assert confirmed[0].startswith("Use the depth 60 mm? Images that are stamped from now on")
    monkeypatch.setattr(slicer.util, "confirmOkCancelDisplay", lambda text: False)
    assert pressed("useDepthButton") == []
    panel._sections._ultrasound.show(UltrasoundShown())
    assert not panel.ui.useDepthButton.isEnabled()


def test_structure_is_switched_with_a_reason_after_a_question(
    panel, pressed, confirmed, monkeypatch
):
    structures = panel._sections._structures
    structures.show((("lesion_2", True), ("chest_wall", False)), is_live=True)
    panel.ui.structureReasonLineEdit.setText("not in the field")
    switched = ("switch_structure", "lesion_2", False, "not in the field")
    assert pressed("switchStructureButton") == [switched]
    assert panel.ui.structureReasonLineEdit.text() == ""
    panel.ui.structureComboBox.setCurrentIndex(1)
    assert panel.ui.structureComboBox.currentText() == "chest wall, off"
    assert pressed("switchStructureButton") == [("switch_structure", "chest_wall", True, "")]
    assert confirmed == [f"lesion 2: guard it no more? The {HELD}", "chest wall: guard it again?"]
    monkeypatch.setattr(slicer.util, "confirmOkCancelDisplay", lambda text: False)
    assert pressed("switchStructureButton") == []
    structures.show((("lesion_2", True),), is_live=False)
    assert not panel.ui.switchStructureButton.isEnabled()


def test_landmarks_are_registered_from_chosen_lists(panel, pressed, application):
    lists = [
        application.scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", name)
        for name in ("fixed", "moving")
    ]
    panel.ui.registrationSourceComboBox.setCurrentIndex(1)
    panel.ui.fixedPointsSelector.setCurrentNode(lists[0])
    panel.ui.movingPointsSelector.setCurrentNode(lists[1])
    assert pressed("registerButton") == [("register_landmarks", *lists)]


def test_slider_seeks_and_settings_take_effect_at_once(panel, pressed, application):
    pressed("playButton")
    calls = panel.logic.panel_logic.calls
    calls.clear()
    panel.ui.seekSlider.setProperty("maximum", 75.0)
    panel.ui.seekSlider.setValue(45.5)
    assert calls == [("seek", 45.5)]
    panel.ui.dilationSpinBox.setValue(3.0)
    panel.ui.contourErrorSpinBox.setValue(0.4)
    assert ("contour.set_options", 3.0, 0.4, 0.0) in calls
    calls.clear()
    panel.ui.opacitySlider.setValue(0.7)
    panel.ui.rateSpinBox.setValue(2.0)
    node = application.scene.AddNewNodeByClass("vtkMRMLLinearTransformNode")
    panel.ui.patientTransformSelector.setCurrentNode(node)
    assert [each for each in calls if not each[0].startswith("contour.")][-3:] == [
        ("view.set_markers", 1.0, 1.4),
        ("set_rate", 2.0),
        ("view.set_patient_to_ras", node),
    ]
    assert ("view.set_opacity", 0.7) in calls
    calls.clear()
    panel.ui.markerSpacingSpinBox.setValue(2.5)
    panel.ui.markerSizeSpinBox.setValue(3.0)
    assert [each for each in calls if each[0] == "view.set_markers"] == [
        ("view.set_markers", 2.5, 1.4),
        ("view.set_markers", 2.5, 3.0),
    ]


def test_mute_button_toggles_alarm(panel):
    panel.ui.muteButton.click()
    assert panel.logic.panel_logic.alarm.muted is True
    panel.ui.muteButton.click()
    assert panel.logic.panel_logic.alarm.muted is False


def test_refused_command_opens_window_with_one_line(panel, errors):
    panel.ui.casePathLineEdit.setText("/no/such/case")
    panel.ui.loadButton.click()
    panel.ui.bullseyeButton.click()
    panel.ui.anteriorViewButton.click()
    panel.ui.registrationSourceComboBox.setCurrentIndex(1)
    panel.ui.registerButton.click()
    assert errors == [
        "/no/such/case: no such folder; expected the folder of a case",
        "nothing is shown yet; expected a session: connect or load a case first",
        "nothing is shown yet; expected a session: connect or load a case first",
        "there is no session; expected one: connect or load a case first",
    ]
    panel.refresh()
    assert panel.ui.bullseyeButton.isChecked() is False


def test_panel_without_session_is_grey_and_enables_possible_commands(panel):
    panel.refresh()
    assert panel.ui.bannerLabel.text() == "? UNKNOWN: nothing was tracked yet"
    assert "background-color: #808080" in panel.ui.bannerLabel.styleSheet()
    enabled = {name for name in BUTTONS if getattr(panel.ui, name).isEnabled()}
    views = {f"{side}ViewButton" for side in ("anterior", "left", "right", "superior")}
    views |= {"bullseyeButton", "centreButton", "showApproachButton", "showNeedleButton"}
    assert enabled == {"connectButton", "registerButton", "muteButton", "loadButton", *views}


@pytest.mark.parametrize(
    "kind", ["vtkMRMLMarkupsFiducialNode", "vtkMRMLMarkupsClosedCurveNode", "vtkMRMLModelNode"]
)
def test_tumour_selector_lists_supported_nodes(panel, pressed, application, kind):
    node = application.scene.AddNewNodeByClass(kind)
    panel.ui.tumorSelector.setCurrentNode(node)
    assert pressed("setTumorButton") == [("set_tumor", node, "")]


@pytest.mark.parametrize("broken", ["spin", "alarm_due"])
def test_failing_spin_makes_banner_unknown(panel, monkeypatch, broken):
    panel._show_banner(SHOWN_STATES["NEGATIVE"], "NEGATIVE: clear, 9.9 mm")

    def fail():
        raise ValueError("a bug")

    monkeypatch.setattr(panel.logic.panel_logic, broken, fail)
    with pytest.raises(ValueError, match="a bug"):
        panel.spin()
    assert panel.ui.bannerLabel.text().startswith("? UNKNOWN")
    assert "background-color: #808080" in panel.ui.bannerLabel.styleSheet()


def test_replayed_case_is_shown(panel, desktop, opens_at_once):
    def until(is_reached):
        wait_until(is_reached, panel.refresh, describe=panel.ui.messageLabel.text)

    ui = panel.ui
    ui.casePathLineEdit.setText(str(CASE))
    ui.loadButton.click()
    until(lambda: ui.playButton.isEnabled())
    assert ui.sessionLabel.text() == "simulated lumpectomy 1 (simulated): paused"
    assert ui.seekSlider.property("maximum") == pytest.approx(
        frame_times_s(opens_at_once)[-1], abs=0.01
    )
    assert (ui.stopSpinBox.value(), ui.warnSpinBox.value()) == (1.0, 5.0)  # the case's
    moment_s = middle_s(DEEP)
    ui.seekSlider.setValue(moment_s)
    until(lambda: ui.bannerLabel.text().startswith("\N{MULTIPLICATION X} POSITIVE"))
    assert (
        f"background-color: {MarginState.POSITIVE.display.color_hex}" in ui.bannerLabel.styleSheet()
    )
    assert re.search(r", -\d\.\d mm$", ui.bannerLabel.text())
    assert "inside" in ui.reasonsLabel.text()
    assert ui.trackersLabel.text().count("valid") == 3
    workflow = ui.workflowLabel.text().splitlines()
    assert workflow[0] == "\N{CHECK MARK} connect: 3 of 3 tracked frames"
    assert [line.split()[1] for line in workflow] == [
        "connect:", "calibrate:", "contour:", "register:", "navigate:", "review:"
    ]  # fmt: skip
    assert "IN TUMOUR" in workflow[4]
    assert desktop.qt.QApplication.beeps > 0
    beeps = desktop.qt.QApplication.beeps
    ui.stepButton.click()
    until(lambda: ui.seekSlider.property("value") > moment_s + 0.01)
    ui.muteButton.click()
    panel.refresh()
    assert desktop.qt.QApplication.beeps == beeps
    ui.playButton.click()
    until(lambda: ui.pauseButton.isEnabled())
    ui.pauseButton.click()
    until(lambda: not ui.pauseButton.isEnabled())


def test_banner_is_drawn_in_colour_of_state(panel):
    panel.refresh()
    panel.parent.resize(430, 1000)
    banner = panel.ui.bannerLabel
    drawn = banner.grab().toImage().pixelColor(2, 2)
    assert (drawn.red(), drawn.green(), drawn.blue()) == (128, 128, 128)


def test_labels_show_plain_text(panel):
    """A node or file name may look like markup, and the rest of the line would be hidden."""
    from PySide6.QtCore import Qt

    labels = [each for each in vars(panel.ui).values() if hasattr(each, "textFormat")]
    messages = [label for label in labels if not label.objectName().endswith(BUDDY)]
    assert len(messages) == 22
    assert {label.textFormat() for label in messages} == {Qt.TextFormat.PlainText}


def test_settings_are_in_parameter_node_and_reset_by_closed_scene(panel, application):
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
    assert before._bindings == {}  # the widgets are disconnected from the settings of before


def test_panel_without_marginguard_shows_one_line(desktop, application, monkeypatch):
    from tests.slicer_module.slicer_double import panel_parent

    monkeypatch.setattr(
        desktop, "missing_requirement", lambda: "MarginGuard needs Python 3.11 or later"
    )
    widget = desktop.MarginGuardWidget(panel_parent(FOLDER))
    widget.setup()
    assert widget.layout.itemAt(0).widget().text() == "MarginGuard needs Python 3.11 or later"
    widget.cleanup()


def test_module_sets_title_help_and_acknowledgement(desktop):
    class Parent:
        """TEST DOUBLE of the module description that Slicer passes."""

    parent = Parent()
    desktop.MarginGuard(parent)
    assert parent.title == "MarginGuard"
    assert "Not a medical device" in parent.helpText
    assert parent.acknowledgementText


def test_module_test_for_slicer_passes_here(desktop, application, opens_at_once, monkeypatch):
    in_slicer(monkeypatch, application)
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
def test_double_refuses_unknown_widgets_and_slots(desktop, tmp_path, was, becomes, message):
    from tests.slicer_module.qt_double import UnknownInUiError

    text = UI.read_text()
    assert was in text
    changed = tmp_path / "changed.ui"
    changed.write_text(text.replace(was, becomes))
    with pytest.raises(UnknownInUiError, match=message):
        slicer.util.loadUI(str(changed))
