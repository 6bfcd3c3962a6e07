"""Parameters of other nodes."""

import logging
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls.parameter_values import TYPE_NAMES, Plain, parameter_value
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner
from ROS2Lib.parameter_watch import ParameterWatch

_USER_EVENT = 1000
"""VTK's first event number for applications."""


class vtkMRMLROS2ParameterNode(Member, vtkMRMLScriptedModuleNode):
    """Monitors parameters of a node. `Spin` invokes ``ParameterModifiedEvent`` on new values."""

    ROLE = "parameter"
    ParameterModifiedEvent = _USER_EVENT + 66

    def __init__(self) -> None:
        self._watch: ParameterWatch | None = None
        self._monitored = ""
        self._values: dict[str, Plain | None] = {}
        self._removed: set[str] = set()

    def GetMonitoredNodeName(self) -> str:
        """Name of the monitored node as given."""
        return self._monitored

    def IsMonitoredNodeReady(self) -> bool:
        """True while the node serves its parameters."""
        return self._watch is not None and self._watch.is_available

    def AddParameter(self, parameterName: str) -> bool:
        """Monitor a parameter; False if it already is. A later `Spin` receives its value."""
        if self._watch is None:
            raise Ros2Error(f"{self.GetName()}: the parameter node is not on a ROS node")
        if parameterName in self._values:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is already monitored")
            return False
        self._removed.discard(parameterName)
        self._values[parameterName] = None
        self._watch.add(parameterName)
        return True

    def RemoveParameter(self, parameterName: str) -> bool:
        """Stop monitoring a parameter; False if it was not monitored."""
        if parameterName not in self._values:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
            return False
        del self._values[parameterName]
        self._removed.add(parameterName)
        if self._watch is not None:
            self._watch.remove(parameterName)
        return True

    def IsParameterSet(self, parameterName: str, noWarning: bool = False) -> bool:
        """True if its value is known. Logs a warning if it is not monitored."""
        if parameterName not in self._values and not noWarning:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
        return self._values.get(parameterName) is not None

    def GetParameterType(self, parameterName: str) -> str:
        """``integer``, ``double_array`` ...; empty while the value is not known."""
        value = self._values.get(parameterName)
        if value is None:
            return ""
        # An empty tuple does not carry the type of its elements.
        if value == ():
            return "array"
        return TYPE_NAMES[parameter_value(value).type].replace("[]", "_array")

    def GetParameterAsBool(self, parameterName: str) -> bool:
        """The value; raises `Ros2Error` if it is not known or of another type."""
        return bool(self._value(parameterName, "bool"))

    def GetParameterAsInteger(self, parameterName: str) -> int:
        """The value."""
        return int(self._value(parameterName, "integer"))

    def GetParameterAsDouble(self, parameterName: str) -> float:
        """The value."""
        return float(self._value(parameterName, "double"))

    def GetParameterAsString(self, parameterName: str) -> str:
        """The value."""
        return str(self._value(parameterName, "string"))

    def GetParameterAsVectorOfBools(self, parameterName: str) -> tuple[bool, ...]:
        """The values."""
        return tuple(self._value(parameterName, "bool_array"))

    def GetParameterAsVectorOfIntegers(self, parameterName: str) -> tuple[int, ...]:
        """The values."""
        return tuple(self._value(parameterName, "integer_array"))

    def GetParameterAsVectorOfDoubles(self, parameterName: str) -> tuple[float, ...]:
        """The values."""
        return tuple(self._value(parameterName, "double_array"))

    def GetParameterAsVectorOfStrings(self, parameterName: str) -> tuple[str, ...]:
        """The values."""
        return tuple(self._value(parameterName, "string_array"))

    def PrintParameter(self, parameterName: str) -> str:
        """The value as text, for any type."""
        value = self._values.get(parameterName)
        return "parameter not found" if value is None else str(value)

    def GetMonitoredParameters(self) -> tuple[str, ...]:
        """Names of the monitored parameters."""
        return tuple(self._values)

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """Name of the monitored node without the leading slash."""
        return (names[0].strip("/"),)

    def status(self) -> str:
        """Number of known parameters, and whether the node is available."""
        known = sum(value is not None for value in self._values.values())
        return (
            f"{known} known{'' if self.IsMonitoredNodeReady() else ', the node is not available'}"
        )

    def spin(self) -> None:
        """Transfer new values and invoke the event if there are any."""
        if self._watch is None:
            return
        new = {
            name: value
            for name, value in self._watch.take().items()
            # By `repr`, because 1, 1.0 and True compare equal.
            if name not in self._removed and repr(self._values.get(name)) != repr(value)
        }
        if new:
            self._values.update(new)
            self.InvokeEvent(self.ParameterModifiedEvent)

    def _value(self, name: str, kind: str) -> Any:
        found = self.GetParameterType(name)
        if not found:
            raise Ros2Error(f"parameter {name!r} of {self._monitored} is not known")
        if found != kind and not (found == "array" and kind.endswith("_array")):
            raise Ros2Error(f"parameter {name!r} of {self._monitored} is {found}; expected {kind}")
        return self._values[name]

    def _start(self, owner: Owner, node: str) -> None:
        self._watch = ParameterWatch(owner.ros, f"/{node.strip('/')}" if node else node)
        self._monitored = node
        self.SetName(f"ros2:param:{node}")
        self.SetModuleName("ROS2")

    def _stop(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None
