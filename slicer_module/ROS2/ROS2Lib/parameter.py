"""Parameters of other nodes."""

import logging
import threading
from collections.abc import Callable
from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge import BridgeError, RosNode
from app.bridge.calls import ParameterChange, ParameterClient, ParameterUnsetError
from app.bridge.calls.parameter_server import TYPE_NAMES, Plain, parameter_value
from ROS2Lib.member import USER_EVENT, Member, Owner, Ros2Error
from ROS2Lib.vtk_values import set_output

_POLL_S = 0.2
_TIMEOUT_S = 5.0
_CLOSE_TIMEOUT_S = 5.0
_MAX_PARAMETERS = 10_000
"""Most parameters of one node; changes of further ones are ignored."""


class ParameterWatch:
    """`add` a name, then `take` new values; the value is None for a parameter that is not set.

    All names are requested again when the node returns after it was gone. Changes of the node's
    other parameters are returned as well. ``changed()`` is called in another thread when there are
    new values.
    """

    def __init__(self, ros: RosNode, node: str, changed: Callable[[], None]) -> None:
        self._ros = ros
        self._changed = changed
        self._client = ParameterClient(ros, node)
        self._condition = threading.Condition()
        self._names: set[str] = set()
        self._unanswered: set[str] = set()
        self._change_counts: dict[str, int] = {}
        self._new: dict[str, Plain | None] = {}
        self._closing = threading.Event()
        self._client.watch(self._take_change)
        self._thread = threading.Thread(target=self._run, name=f"parameters of {node}", daemon=True)
        self._thread.start()

    @property
    def is_available(self) -> bool:
        """True while the node serves its parameters."""
        return self._client.is_available

    def add(self, name: str) -> None:
        """Request the value of ``name``."""
        with self._condition:
            self._names.add(name)
            self._unanswered.add(name)
            self._condition.notify()

    def remove(self, name: str) -> None:
        """Stop requesting ``name``."""
        with self._condition:
            self._names.discard(name)
            self._unanswered.discard(name)

    def take(self) -> dict[str, Plain | None]:
        """New values since the last call."""
        with self._condition:
            new, self._new = self._new, {}
        return new

    def close(self) -> None:
        """Stop the thread and leave the graph."""
        self._closing.set()
        with self._condition:
            self._condition.notify()
        self._thread.join(_CLOSE_TIMEOUT_S)
        self._ros.call(self._client.close)

    def _take_change(self, change: ParameterChange) -> None:
        for name, value in {**change.values, **dict.fromkeys(change.deleted)}.items():
            with self._condition:
                if name in self._change_counts or len(self._change_counts) < _MAX_PARAMETERS:
                    self._change_counts[name] = self._change_counts.get(name, 0) + 1
                    self._new[name] = value
        self._changed()

    def _run(self) -> None:
        was_available = False
        while not self._closing.is_set():
            with self._condition:
                if not (self._unanswered and was_available) and not self._closing.is_set():
                    self._condition.wait(_POLL_S)
                requested = set(self._unanswered)
            is_available = self._client.is_available
            if is_available and not was_available:
                with self._condition:
                    requested = set(self._names)
            was_available = is_available and self._get(requested)

    def _get(self, names: set[str]) -> bool:
        """Request ``names``; False if the node did not answer."""
        for name in names:
            with self._condition:
                count = self._change_counts.get(name, 0)
            value: Plain | None = None
            try:
                value = self._client.get(name, _TIMEOUT_S, self._closing)
            except ParameterUnsetError:
                value = None
            except BridgeError:  # gone, no reply, invalid value or closing: requested again
                return False
            with self._condition:
                self._unanswered.discard(name)
                # A change received in the meantime is newer than the answer.
                if name in self._names and self._change_counts.get(name, 0) == count:
                    self._new[name] = value
            self._changed()
        return True


def _reader(kind: str, convert: Callable[[Any], Any]) -> Callable[..., Any]:
    def read(self: "vtkMRMLROS2ParameterNode", parameterName: str, result: Any = None) -> Any:
        """The value; raises `Ros2Error` if it is not known or of another type.

        With ``result``, a `vtk.reference`, sets it and returns True; returns False and leaves it
        if the value is not known or of another type.
        """
        if result is None:
            return convert(self.value_of(parameterName, kind))
        try:
            return set_output(result, convert(self.value_of(parameterName, kind)))
        except Ros2Error as error:
            logging.warning(f"{self.GetName()}: {error}")
            return False

    return read


class vtkMRMLROS2ParameterNode(Member, vtkMRMLScriptedModuleNode):
    """Monitors parameters of a node. `Spin` invokes ``ParameterModifiedEvent`` on new values."""

    ROLE = "parameter"
    ParameterModifiedEvent = USER_EVENT + 66

    def __init__(self) -> None:
        self._watch: ParameterWatch | None = None
        self._monitored = ""
        self._values: dict[str, Plain | None] = {}
        self._removed: set[str] = set()
        self._added: set[str] = set()

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
        self._added.add(parameterName)
        self.save_state()
        return True

    def RemoveParameter(self, parameterName: str) -> bool:
        """Stop monitoring a parameter; False if it was not monitored."""
        if parameterName not in self._values:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
            return False
        del self._values[parameterName]
        self._removed.add(parameterName)
        self._added.discard(parameterName)
        self.save_state()
        if self._watch is not None:
            self._watch.remove(parameterName)
        return True

    def IsParameterSet(self, parameterName: str, noWarning: bool = False) -> bool:
        """True if its value is known. Logs a warning if it is not monitored."""
        if parameterName not in self._values and not noWarning:
            logging.warning(f"{self.GetName()}: parameter {parameterName!r} is not monitored")
        return self._values.get(parameterName) is not None

    def ParameterSet(self, parameterName: str) -> bool:
        """Return `IsParameterSet`, without a log line."""
        return self.IsParameterSet(parameterName, noWarning=True)

    def GetParameterType(self, parameterName: str, result: Any = None) -> Any:
        """``integer``, ``double_array`` ...; empty while the value is not known.

        With ``result``, a `vtk.reference`, it is set to the type, and True is returned if the
        value is known.
        """
        found = self._type_of(parameterName)
        return found if result is None else set_output(result, found) and found != ""

    def _type_of(self, parameterName: str) -> str:
        value = self._values.get(parameterName)
        if value is None:
            return ""
        # An empty tuple does not carry the type of its elements.
        if value == ():
            return "array"
        return TYPE_NAMES[parameter_value(value).type].replace("[]", "_array")

    GetParameterAsBool = _reader("bool", bool)

    GetParameterAsInteger = _reader("integer", int)

    GetParameterAsDouble = _reader("double", float)

    GetParameterAsString = _reader("string", str)

    GetParameterAsVectorOfBools = _reader("bool_array", tuple)

    GetParameterAsVectorOfIntegers = _reader("integer_array", tuple)

    GetParameterAsVectorOfDoubles = _reader("double_array", tuple)

    GetParameterAsVectorOfStrings = _reader("string_array", tuple)

    def PrintParameterValue(self, parameterName: str, result: Any = None) -> str | bool:
        """Return `PrintParameter`; ``result``, a `vtk.reference`, is as in `GetParameterAsBool`."""
        if result is None:
            return self.PrintParameter(parameterName)
        known = self._values.get(parameterName) is not None
        return set_output(result, self.PrintParameter(parameterName) if known else None)

    def PrintParameter(self, parameterName: str) -> str:
        """The value as text, for any type."""
        value = self._values.get(parameterName)
        return "parameter not found" if value is None else str(value)

    def settings(self) -> dict[str, Any]:
        """The parameters that a script has added."""
        return {"parameters": sorted(self._added)}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Request these parameters when the node joins a ROS node."""
        names = settings["parameters"]
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise Ros2Error(f"parameters are {names!r}; expected a list of names")
        self._added = set(names)

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

    def value_of(self, name: str, kind: str) -> Any:
        """The value of a parameter; raises `Ros2Error` if it is not known or not a ``kind``."""
        found = self._type_of(name)
        if not found:
            raise Ros2Error(f"parameter {name!r} of {self._monitored} is not known")
        if found != kind and not (found == "array" and kind.endswith("_array")):
            raise Ros2Error(f"parameter {name!r} of {self._monitored} is {found}; expected {kind}")
        return self._values[name]

    def _start(self, owner: Owner, node: str) -> None:
        watched = f"/{node.strip('/')}" if node else node
        self._watch = ParameterWatch(owner.ros, watched, owner.wake)
        self._monitored = node
        for name in self._added:
            self._values.setdefault(name, None)
            self._watch.add(name)
        self.SetName(f"ros2:param:{node}")

    def _stop(self) -> None:
        if self._watch is not None:
            self._watch.close()
            self._watch = None
