"""Draws the panel at the recorded case's first breach, with TEST DOUBLES of Slicer's widgets.

    python -m tests.slicer_module.draw_panel PANEL.png TOUCH.png PLANS.png

The pictures of docs/slicer.md, the second one after a registration by touch, the third one with
plans. Draw them again and inspect them when the .ui changes.
"""

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

os.environ["QT_QPA_PLATFORM"] = "offscreen"

import slicer
from PySide6.QtCore import QRect

from app.scene import SceneApplication
from tests.shipped_case import DEEP, middle_s
from tests.slicer_module import qt_double, slicer_double
from tests.slicer_module.marginguard_module import CASE, CLEAR_S, FOLDER, write_plans

BREACH_S = middle_s(DEEP)
SIZE, TOUCH_SIZE, PLANS_SIZE = (490, 1760), (490, 1340), (490, 960)
DWELLS_END_S = 19.0
SECTIONS = ("connect", "tumor", "navigation", "breaches", "notes", "replay")


def main(path: str, touch_path: str, plans_path: str) -> None:
    """Load the case, seek to its breach, and save the panel as PNG; then register, then plan."""
    application = SceneApplication(slicer.vtkMRMLScene())
    slicer.mrmlScene = application.scene
    slicer.app = SimpleNamespace(applicationLogic=lambda: application.logic)
    sys.modules |= slicer_double.stand_ins()
    gui = qt_double.QApplication([])
    import MarginGuard

    pause = threading.Event()

    def until(is_reached: Callable[[], bool]) -> None:
        while not is_reached():
            gui.processEvents()
            pause.wait(0.01)

    widget = MarginGuard.MarginGuardWidget(slicer_double.panel_parent(FOLDER))
    widget.setup()
    widget.ui.casePathLineEdit.setText(str(CASE.relative_to(CASE.parents[1])))
    widget.ui.configPathLineEdit.setText("data/live_example/live.yaml")
    widget.ui.registrationPathLineEdit.setText("data/recorded_case")
    widget.ui.loadButton.click()
    until(widget.ui.playButton.isEnabled)
    widget.ui.seekSlider.setValue(BREACH_S)
    until(lambda: widget.ui.bannerLabel.text().startswith("\N{MULTIPLICATION X} POSITIVE"))
    until(widget.ui.directionsLabel.text)

    def save(target: str, size: tuple[int, int]) -> None:
        widget.parent.resize(*size)
        gui.processEvents()
        widget.parent.grab(QRect(0, 0, *size)).save(target)

    save(path, SIZE)
    logic = widget.logic.panel_logic
    widget.ui.seekSlider.setValue(0.0)
    until(lambda: logic.session.position_s < 1.0)
    for name in SECTIONS:
        getattr(widget.ui, f"{name}CollapsibleButton").setProperty("collapsed", True)
    for name in ("calibration", "registration"):
        getattr(widget.ui, f"{name}CollapsibleButton").setProperty("collapsed", False)
    widget.ui.startTouchButton.click()
    widget.ui.startPivotButton.click()
    widget.ui.rateSpinBox.setValue(20.0)
    widget.ui.playButton.click()
    until(lambda: logic.session.position_s > DWELLS_END_S)
    widget.ui.stopTouchButton.click()
    until(widget.ui.useTouchButton.isEnabled)
    widget.ui.pauseButton.click()
    until(lambda: not widget.ui.pauseButton.isEnabled())
    save(touch_path, TOUCH_SIZE)
    for name in ("calibration", "registration"):
        getattr(widget.ui, f"{name}CollapsibleButton").setProperty("collapsed", True)
    widget.ui.plansCollapsibleButton.setProperty("collapsed", False)
    widget.ui.seekSlider.setValue(CLEAR_S)
    until(lambda: CLEAR_S <= logic.session.position_s < DWELLS_END_S)
    with TemporaryDirectory() as folder:
        approach, needle = write_plans(Path(folder), logic.session)
        logic.plans.show_approach(approach)
        logic.plans.show_needle(needle)
    widget.ui.beginGoalButton.click()
    widget.ui.approachPathLineEdit.setText("approach.json")
    widget.ui.needlePathLineEdit.setText("needle.json")
    widget.refresh()
    save(plans_path, PLANS_SIZE)
    widget.cleanup()


if __name__ == "__main__":
    main(*sys.argv[1:])
