"""Base of all MRML nodes that belong to a ROS node."""

import json
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FunctionType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.calls import CallError, GoalEndedError
from app.bridge.convert import type_name
from app.geometry import MarginGuardError

if TYPE_CHECKING:
    from slicer import vtkMRMLNode as _Node

    from ROS2Lib.host import RosHost

    Owner: TypeAlias = RosHost
else:
    Owner = Any  # its module imports this one
    _Node = object  # at run time the MRML class beside it in the bases is the node

USER_EVENT = 1000
"""VTK's first event number for applications."""


class MrmlClass(_Node):
    """Class names and type tests as of SlicerROS2's compiled classes.

    The scene's C++ code uses the name of the MRML base class instead.
    """

    def __init_subclass__(cls) -> None:
        """Name the calls that a function has made as `help` and error messages show them."""
        super().__init_subclass__()
        for name, call in vars(cls).items():
            if isinstance(call, FunctionType) and "<locals>" in call.__qualname__:
                call.__name__, call.__qualname__ = name, f"{cls.__qualname__}.{name}"

    def GetClassName(self) -> str:
        """Class name as in SlicerROS2."""
        return type(self).__name__

    def GetNodeTagName(self) -> str:
        """Tag of the node in a scene saved by SlicerROS2."""
        short = type(self).__name__.removeprefix("vtkMRML").removesuffix("Node")
        return {"ROS2Node": "ROS2Node", "ROS2Robot": "ROS2RobotNode"}.get(short, short)

    def IsA(self, name: str) -> bool:
        """True for the class name of SlicerROS2, and for those of all base classes."""
        return any(each.__name__ == name for each in type(self).__mro__) or bool(super().IsA(name))

    @classmethod
    def SafeDownCast(cls, node: Any) -> Any:
        """``node`` if it is of this class; otherwise None."""
        return node if isinstance(node, cls) else None


_CLASS, _KIND, _NAMES, _SETTINGS = "ros2.class", "ros2.kind", "ros2.names", "ros2.settings"


@contextmanager
def without_events(node: Any) -> Iterator[None]:
    """Change ``node`` without ``ModifiedEvent``, which means a message or a response to scripts."""
    before = node.GetDisableModifiedEvent()
    node.SetDisableModifiedEvent(1)
    try:
        yield
    finally:
        node.SetDisableModifiedEvent(before)


@dataclass(frozen=True, slots=True)
class SavedState:
    """Class, kind, names on the ROS graph and settings of a ROS node or of one of its members.

    A saved scene holds them in attributes of the MRML node.
    """

    family: str
    kind: str
    names: tuple[str, ...]
    settings: dict[str, Any]

    def store(self, node: Any) -> None:
        """Write the attributes of ``node``."""
        with without_events(node):
            node.SetAttribute(_CLASS, self.family)
            node.SetAttribute(_KIND, self.kind)
            node.SetAttribute(_NAMES, json.dumps(self.names))
            node.SetAttribute(_SETTINGS, json.dumps(self.settings))

    @staticmethod
    def forget(node: Any) -> None:
        """Remove the attributes, so that a loaded scene does not create the node again."""
        with without_events(node):
            for name in (_CLASS, _KIND, _NAMES, _SETTINGS):
                node.RemoveAttribute(name)

    @classmethod
    def load(cls, node: Any) -> "SavedState | None":
        """State in the attributes of ``node``; None without one.

        Raises ValueError for attributes of another form.
        """
        family = node.GetAttribute(_CLASS)
        if family is None:
            return None
        names = json.loads(node.GetAttribute(_NAMES) or "[]")
        settings = json.loads(node.GetAttribute(_SETTINGS) or "{}")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise ValueError(f"{_NAMES} is {names!r}; expected a list of strings")
        if not isinstance(settings, dict):
            raise ValueError(f"{_SETTINGS} is {settings!r}; expected an object")
        return cls(family, node.GetAttribute(_KIND) or "", tuple(names), settings)


Kind = TypeVar("Kind", bound="Member")


class Member(MrmlClass, _Node):
    """Mixin for MRML node classes; `ROLE` and `key` identify the member on its ROS node.

    The ROS node refers to its members by MRML references: role ``publisher``, ``service_client``
    and so on. The member's attributes hold what a saved scene needs to create it again
    (`SavedState`).

    A subclass implements `_start` (join the graph; raises `MarginGuardError`), `_stop` (leave it)
    and `spin` (transfer received data into the scene, in the scene's thread).
    """

    ROLE = ""
    _owner: Owner | None = None
    _names: tuple[str, ...] = ()

    def AddToROS2Node(self, nodeId: str, *names: str) -> bool:
        """Join the graph as a member of ROS node ``nodeId``; on error log it, return False."""
        return self.add_to(nodeId, names)

    def add_to(self, node_id: str, names: tuple[str, ...]) -> bool:
        """Join the graph like `AddToROS2Node`, with the names in the order of `_start`."""
        scene = self.GetScene()
        owner = None if scene is None else scene.GetNodeByID(node_id)
        if owner is None or not hasattr(owner, "adopt"):
            logging.error(f"{self.GetClassName()}: no ROS 2 node {node_id!r} in its scene")
            return False
        try:
            owner.adopt(self, names)
        except MarginGuardError as error:
            logging.error(str(error))
            return False
        return True

    def RemoveFromROS2Node(self, nodeId: str, *names: str) -> bool:
        """Leave the graph and stay in the scene; False, with a log line, if it is not there."""
        owner = self._owner
        if owner is None or owner.GetID() != nodeId or (names and self._names != names):
            what = " ".join(names)
            logging.error(f"{self.GetName()} is not on ROS 2 node {nodeId!r} {what}".rstrip())
            return False
        owner.release(self)
        return True

    def IsAddedToROS2Node(self) -> bool:
        """True while it belongs to a ROS node."""
        return self._owner is not None

    def join(self, owner: Owner, names: tuple[str, ...]) -> None:
        """Become a member of ``owner``. Called by the ROS node only."""
        self._start(owner, *names)
        self._owner, self._names = owner, names
        with without_events(self):
            self.SetNodeReferenceID("node", owner.GetID())
            if isinstance(self, vtkMRMLScriptedModuleNode):
                self.SetModuleName("ROS2")
        self.save_state()

    def leave(self) -> None:
        """Leave the owner. Called by the ROS node only."""
        if self._owner is not None:
            try:
                self._stop()
            finally:
                self._owner = None
                with without_events(self):
                    self.SetNodeReferenceID("node", None)
                SavedState.forget(self)

    def status(self) -> str:
        """Short status for the listing."""
        raise NotImplementedError

    def spin(self) -> None:
        """Transfer received data into the scene. Called by the ROS node only."""

    @classmethod
    def reference_role(cls) -> str:
        """Role of the ROS node's MRML references to members of this kind."""
        return cls.ROLE.replace(" ", "_")

    def save_state(self) -> None:
        """Update the attributes that a saved scene keeps; called when one of `settings` changes."""
        if self._owner is not None:
            kind = str(getattr(self, "KIND", ""))  # of a topic, service or action
            SavedState(self.family(), kind, self._names, self.settings()).store(self)

    @classmethod
    def family(cls) -> str:
        """Name of the class without its kind: that which sets `ROLE`."""
        return next(each.__name__ for each in cls.__mro__ if "ROLE" in vars(each))

    def settings(self) -> dict[str, Any]:
        """Plain values that `apply_settings` of a member of the same class takes."""
        return {}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Take values of a saved scene, before the member joins a ROS node.

        Raises `MarginGuardError`, KeyError, TypeError or ValueError for values of another form.
        """

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """Key that is unique among the members of one role on a ROS node: the resolved name."""
        return (owner.resolve(names[0]),)

    def _start(self, owner: Owner, *names: Any) -> None:
        raise NotImplementedError

    def _stop(self) -> None:
        raise NotImplementedError


class Ros2Error(MarginGuardError):
    """Invalid call: a name in use, a node outside the ROS graph, a value of another type."""


def references(node: Any, role: str) -> list[Any]:
    """The nodes in the scene that ``node`` refers to by ``role``."""
    each = (node.GetNthNodeReference(role, n) for n in range(node.GetNumberOfNodeReferences(role)))
    return [found for found in each if found is not None]


class TypedMember(Member):
    """Base of members of a kind of topic, service or action; `kind_class` derives their classes."""

    KIND = ""
    _type: Any = None

    def GetROSType(self) -> str:
        """Full name of the ROS type, such as ``std_srvs/srv/Trigger``."""
        return type_name(self._type)


class PendingCall:
    """A request or a goal under way, in a thread that waits for its end.

    ``call(cancel)`` returns the reply. ``ended()`` is called in the thread.
    """

    def __init__(
        self, name: str, call: Callable[[threading.Event], Any], ended: Callable[[], None]
    ) -> None:
        self.reply: Any = None
        self.error = ""
        self.done, self.cancel = threading.Event(), threading.Event()
        self._call, self._ended = call, ended
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def _run(self) -> None:
        try:
            self.reply = self._call(self.cancel)
        except CallError as error:
            self.error = str(error)
            self.reply = error.result if isinstance(error, GoalEndedError) else None
        self.done.set()
        self._ended()


class ClientMember(TypedMember):
    """Base of clients of services and actions: the timeout of their requests."""

    _timeout_s = 0.0
    _error = ""

    def GetLastError(self) -> str:
        """The reason why the last request or goal has not succeeded; empty if it has."""
        return self._error

    def SetTimeoutSeconds(self, seconds: float) -> None:
        """Set the timeout of later requests or goals in s, including discovery of the server."""
        if not 0.0 < seconds <= 1e6:
            raise Ros2Error(
                f"{self.GetName()}: timeout is {seconds} s; expected more than 0, at most 1e6"
            )
        self._timeout_s = seconds
        self.save_state()

    def settings(self) -> dict[str, Any]:
        """The timeout."""
        return {"timeout_s": self._timeout_s}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set the timeout."""
        self.SetTimeoutSeconds(float(settings["timeout_s"]))
