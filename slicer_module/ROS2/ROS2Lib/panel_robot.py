"""Fields of the panel that describe a robot."""

from typing import Any

from ROS2Lib.logic import Ros2Api
from ROS2Lib.robot_sources import DEFAULTS, FILE, MESH_MAP, PARAMETER, TOPIC

_JOINT_STATES = "joint states"


class RobotForm:
    """Reads the fields of ``ui``, and shows which of them belong to the chosen source."""

    def __init__(self, ui: Any) -> None:
        self._ui = ui
        ui.sourceComboBox.currentIndexChanged.connect(self._on_source)
        ui.posesComboBox.currentIndexChanged.connect(self._on_poses)

    @property
    def name(self) -> str:
        """Name of the robot."""
        return _text(self._ui.robotNameLineEdit)

    def choose(self, name: str) -> None:
        """Put the name of a robot into its field."""
        self._ui.robotNameLineEdit.setText(name)

    def add(self, logic: Ros2Api) -> Any:
        """Add the robot; None, with a log line, if it was not added. Raises `MarginGuardError`."""
        ui, source = self._ui, self._source()
        path = str(ui.descriptionPathLineEdit.property("currentPath")).strip()
        return logic.AddRobot(
            self.name,
            _text(ui.parameterNodeLineEdit) if source in (PARAMETER, MESH_MAP) else "",
            path if source == FILE else _text(ui.parameterLineEdit),
            _text(ui.fixedFrameLineEdit),
            _text(ui.tfPrefixLineEdit),
            source,
            _text(ui.jointStatesLineEdit) if self._follows_joints() else "",
        )

    def _source(self) -> str:
        return str(self._ui.sourceComboBox.property("currentText"))

    def _follows_joints(self) -> bool:
        return str(self._ui.posesComboBox.property("currentText")) == _JOINT_STATES

    def _on_source(self, _: int) -> None:
        source = self._source()
        node, name = DEFAULTS[source]
        ui = self._ui
        ui.parameterNodeLineEdit.setEnabled(source in (PARAMETER, MESH_MAP))
        ui.parameterLineEdit.setEnabled(source in (PARAMETER, TOPIC, MESH_MAP))
        ui.descriptionPathLineEdit.setEnabled(source == FILE)
        ui.parameterNodeLineEdit.setText(node)
        ui.parameterLineEdit.setText(name)

    def _on_poses(self, _: int) -> None:
        self._ui.jointStatesLineEdit.setEnabled(self._follows_joints())


def _text(field: Any) -> str:
    return str(field.property("text")).strip()
