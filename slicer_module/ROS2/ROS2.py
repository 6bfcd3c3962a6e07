"""ROS 2 in desktop 3D Slicer: a small panel, and the logic for scripts.

``slicer.util.getModuleLogic('ROS2')`` returns the logic, which is in `ROS2Lib`. It is imported when
the panel is made, so that a Slicer without ROS 2 shows a one-line message instead of a traceback.
"""

import sys

import ctk
import qt
import slicer
from slicer.ScriptedLoadableModule import ScriptedLoadableModule, ScriptedLoadableModuleWidget
from slicer.util import VTKObservationMixin

LIST_MS = 200
"""Interval of the timer that updates the list of nodes."""


class ROS2(ScriptedLoadableModule):
    """Module description for Slicer."""

    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "ROS2"
        parent.categories = ["IGT"]
        parent.dependencies = []
        parent.contributors = ["MarginGuard developers"]
        parent.helpText = (
            "Topics, parameters, services, tf and robots of ROS 2 as nodes of the scene, with the "
            "calls that SlicerROS2's scripts make: "
            "<code>slicer.util.getModuleLogic('ROS2').GetDefaultROS2Node()</code>. "
            "docs/ros2_module.md of MarginGuard lists them and the differences.<br><br>"
            "<b>Not a medical device</b>: a research tool that must not guide a treatment."
        )
        parent.acknowledgementText = (
            "Part of MarginGuard, Apache-2.0. The names of the calls are those of SlicerROS2."
        )


class ROS2Widget(ScriptedLoadableModuleWidget, VTKObservationMixin):
    """Panel that spins the logic, lists the ROS nodes, and adds and removes robots."""

    def __init__(self, parent=None):
        ScriptedLoadableModuleWidget.__init__(self, parent)
        VTKObservationMixin.__init__(self)
        self.logic = None
        self._spinner = None
        self._list_timer = None
        self._listed = ""
        self.robot_form = None
        self.tables = None

    def setup(self):
        """Build the panel and the default ROS node; without ROS 2, a one-line message."""
        ScriptedLoadableModuleWidget.setup(self)
        try:
            from app.runtime import SWITCH_INTERVAL_S, QtSpinner
            from ROS2Lib.class_names import register_classes
            from ROS2Lib.logic import MemberTables, RobotForm, Ros2Api
        except ImportError as error:
            self.layout.addWidget(
                qt.QLabel(
                    f"ROS 2 cannot be loaded ({' '.join(str(error).split())}): "
                    "start Slicer with 'marginguard slicer --slicer PATH'"
                )
            )
            return
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        register_classes(slicer)
        panel = slicer.util.loadUI(self.resourcePath("UI/ROS2.ui"))
        self.layout.addWidget(panel)
        self.ui = slicer.util.childWidgetVariables(panel)
        self.ui.descriptionPathLineEdit.filters = ctk.ctkPathLineEdit.Files
        self.robot_form = RobotForm(self.ui)
        self.tables = MemberTables(self.ui, qt.QTableWidgetItem, self.robot_form.choose)
        self.ui.addRobotButton.clicked.connect(self.on_add_robot)
        self.ui.removeRobotButton.clicked.connect(self.on_remove_robot)
        self.logic = Ros2Api(slicer.mrmlScene, self._received)
        self._make_default_node()
        # Closing the scene removes all nodes; scripts look the default one up by name.
        self.addObserver(
            slicer.mrmlScene, slicer.vtkMRMLScene.EndCloseEvent, self._make_default_node
        )
        self._spinner = QtSpinner(qt, self.spin)
        self.spin()
        self._list_timer = qt.QTimer()
        self._list_timer.setInterval(LIST_MS)
        self._list_timer.timeout.connect(self._list)
        self._list_timer.start()

    def cleanup(self):
        """Leave the ROS graph when the module is unloaded."""
        if self.logic is None:
            return
        self._spinner.stop()
        self._list_timer.stop()
        self.removeObservers()
        self.logic.Close()

    def spin(self):
        """Transfer received data into the scene. Called when data have arrived."""
        self.logic.Spin()

    def on_add_robot(self, checked=False):
        """Add the robot described by the fields."""
        text = f"robot {self.robot_form.name!r} was not added: see the log"
        self._do(lambda: self.robot_form.add(self.logic), text)

    def on_remove_robot(self, checked=False):
        """Remove the robot with the name in the field."""
        name = self.robot_form.name
        self._do(lambda: self.logic.RemoveRobot(name), f"there is no robot {name!r}")

    def _received(self):
        """Wake Qt's thread; called in ROS's threads."""
        if self._spinner is not None:
            self._spinner.wake()

    def _make_default_node(self, caller=None, event=None):
        self._do(self.logic.GetDefaultROS2Node)

    def _do(self, action, otherwise=""):
        """Run ``action()``; show its error, or ``otherwise`` if it returns a false value."""
        from app.geometry import MarginGuardError

        try:
            text = "" if action() else otherwise
        except MarginGuardError as error:
            text = str(error)
        self.ui.messageLabel.setText(text)
        self._list()

    def _list(self):
        text = self.logic.listing()
        if text != self._listed:
            self._listed = text
            self.ui.nodesLabel.setText(text)
        self.tables.update(self.logic)
