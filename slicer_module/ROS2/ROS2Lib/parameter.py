"""Parameters of other nodes."""

import logging
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls.parameter_values import TYPE_NAMES, Plain, parameter_value
from ROS2Lib.errors import Ros2Error
from ROS2Lib.member import Member, Owner
from ROS2Lib.parameter_watch import ParameterWatch

_USER_EVENT = 1000
"""VTK's first number for events of others."""


class vtkMRMLROS2ParameterNode(Member, vtkMRMLScriptedModuleNode):
    """``ParameterModifiedEvent`` comes in `Spin` when values of the monitored node are new."""

    ROLE = "parameter"
    ParameterModifiedEvent = _USER_EVENT + 66

    def __init__(self) -> None:
        self._watch: ParameterWatch | None = None
        self._monitored = ""
        self._values: dict[str, Plain | None] = {}
        self._removed: set[str] = set()

    def GetMonitoredNodeName(self) -> str:
        """The node whose parameters they are, as it was given."""
        return self._monitored

    def IsMonitoredNodeReady(self) -> bool:
        """Whether it serves its parameters now."""
        return self._watch is not None and self._watch.is_available

    def AddParameter(self, parameterName: str) -> bool:
        """Monitor a parameter; False when it is already. Its value comes in a later `Spin`."""
        if self._watch is None:
            raise Ros2Error(f"{self.GetName()}: the parameter node is not on a ROS node")
        if parameterName in self._values:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is monitored already")
            return False
        self._removed.discard(parameterName)
        self._values[parameterName] = None
        self._watch.ask(parameterName)
        return True

    def RemoveParameter(self, parameterName: str) -> bool:
        """Monitor it no more; False when it was not."""
        if parameterName not in self._values:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
            return False
        del self._values[parameterName]
        self._removed.add(parameterName)
        if self._watch is not None:
            self._watch.forget(parameterName)
        return True

    def IsParameterSet(self, parameterName: str, noWarning: bool = False) -> bool:
        """Whether its value is known; false too for one that is not monitored, which is said."""
        if parameterName not in self._values and not noWarning:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
        return self._values.get(parameterName) is not None

    def GetParameterType(self, parameterName: str) -> str:
        """``integer``, ``double_array`` ...; empty for one whose value is not known."""
        value = self._values.get(parameterName)
        if value is None:
            return ""
        # A tuple that is empty has lost its type on the way here.
        if value == ():
            return "array"
        return TYPE_NAMES[parameter_value(value).type].replace("[]", "_array")

    def GetParameterAsBool(self, parameterName: str) -> bool:
        """The value; raises `Ros2Error` when it is not known or of another type."""
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
        """The value in words, whatever its type."""
        value = self._values.get(parameterName)
        return "parameter not found" if value is None else str(value)

    def GetMonitoredParameters(self) -> tuple[str, ...]:
        """The names of those whose changes are heard."""
        return tuple(self._values)

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The monitored node, with or without the first slash."""
        return (names[0].strip("/"),)

    def status(self) -> str:
        """Whether the node is there, and how many of its parameters are known."""
        known = sum(value is not None for value in self._values.values())
        return f"{known} known{'' if self.IsMonitoredNodeReady() else ', the node is not there'}"

    def spin(self) -> None:
        """Take in what is new, and say so when anything is."""
        if self._watch is None:
            return
        new = {
            name: value
            for name, value in self._watch.take().items()
            # Not by their values: 1, 1.0 and True are equal.
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
            raise Ros2Error(f"parameter {name!r} of {self._monitored} is {found}: no {kind}")
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
