"""Base of all MRML nodes that belong to a ROS node."""

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from slicer import vtkMRMLScriptedModuleNode

from app.bridge import RosNode
from app.bridge.tf import TransformBuffer
from app.bridge.tf_topics import TfBroadcaster
from app.geometry import MarginGuardError
from ROS2Lib.mrml_class import MrmlClass
from ROS2Lib.saved_state import SavedState, without_events

if TYPE_CHECKING:
    from slicer import vtkMRMLNode as _Node
else:
    _Node = object  # at run time the MRML class beside it in the bases is the node

Kind = TypeVar("Kind", bound="Member")


class Owner(Protocol):
    """Interface of a ROS node for its members; implemented by `RosHost`."""

    @property
    def ros(self) -> RosNode:
        """The node on the graph."""

    @property
    def buffer(self) -> TransformBuffer:
        """Received transforms."""

    @property
    def broadcaster(self) -> TfBroadcaster:
        """Publisher on tf."""

    def GetID(self) -> str:
        """MRML ID."""

    def wake(self) -> None:
        """Signal that data wait for `Spin`; from any thread."""

    def now_ns(self) -> int:
        """Time in ns on its clock."""

    def stamp(self, message: Any, frame_id: str) -> None:
        """Fill in an empty stamp and frame of a header."""

    def resolve(self, name: str) -> str:
        """Resolved name of a topic or service."""

    def create(
        self, kind: type[Kind], *names: str, prepare: Callable[[Kind], None] = ...
    ) -> Kind | None:
        """Create another member, after ``prepare(member)``."""

    def find(self, kind: type[Kind], *names: str) -> Kind | None:
        """The member of this kind and name."""

    def remove(self, member: "Member | None", what: str) -> bool:
        """Remove a member from graph and scene."""

    def release(self, member: "Member") -> None:
        """Remove a member from the graph; it stays in the scene."""


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
            SavedState(self.family(), self.kind_name(), self._names, self.settings()).store(self)

    @classmethod
    def family(cls) -> str:
        """Name of the class without its kind: that which sets `ROLE`."""
        return next(each.__name__ for each in cls.__mro__ if "ROLE" in vars(each))

    @classmethod
    def kind_name(cls) -> str:
        """Kind of a topic, service or action; empty for other members."""
        return str(getattr(cls, "KIND", ""))

    def settings(self) -> dict[str, Any]:
        """Plain values that `apply_settings` of a member of the same class takes."""
        return {}

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Take values of a saved scene, before the member joins a ROS node.

        Raises `MarginGuardError`, KeyError, TypeError or ValueError for values of another form.
        """

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """Key that is unique among the members of one role on a ROS node."""
        raise NotImplementedError

    def _start(self, owner: Owner, *names: Any) -> None:
        raise NotImplementedError

    def _stop(self) -> None:
        raise NotImplementedError
