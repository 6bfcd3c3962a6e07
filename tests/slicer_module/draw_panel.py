"""Draws the panel at the recorded case's first breach, with TEST DOUBLES of Slicer's widgets.

    python -m tests.slicer_module.draw_panel docs/images/slicer_panel.png

The picture of docs/slicer.md. Draw it again and inspect it when the .ui changes.
"""

import os
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace

os.environ["QT_QPA_PLATFORM"] = "offscreen"

import slicer

from app.scene import SceneApplication
from tests.shipped_case import DEEP, middle_s
from tests.slicer_module import qt_double, slicer_double
from tests.slicer_module.marginguard_module import CASE, FOLDER

BREACH_S = middle_s(DEEP)
SIZE = (430, 1250)


def main(path: str) -> None:
    """Load the case, seek to its breach, and save the panel as PNG."""
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
    widget.ui.registerButton.click()
    until(widget.ui.acceptButton.isEnabled)
    widget.ui.seekSlider.setValue(BREACH_S)
    until(lambda: widget.ui.bannerLabel.text().startswith("\N{MULTIPLICATION X} POSITIVE"))
    widget.parent.resize(*SIZE)
    gui.processEvents()
    widget.parent.grab().save(path)
    widget.cleanup()


if __name__ == "__main__":
    main(sys.argv[1])
