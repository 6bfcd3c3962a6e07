"""What all nodes in the scene that hang on a ROS node have in common."""

import logging
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from app.bridge import RosNode
from app.bridge.tf import TransformBuffer
from app.bridge.tf.broadcaster import TfBroadcaster
from app.geometry import MarginGuardError

if TYPE_CHECKING:
    from slicer import vtkMRMLNode as _Node
else:
    _Node = object  # the class of MRML that it is mixed into is the node

Kind = TypeVar("Kind", bound="Member")


class Owner(Protocol):
    """What members ask of their ROS node; `RosHost` says what each of these does."""

    @property
    def ros(self) -> RosNode:
        """The node on the graph."""

    @property
    def buffer(self) -> TransformBuffer:
        """What tf has said."""

    @property
    def broadcaster(self) -> TfBroadcaster:
        """To tf."""

    def GetID(self) -> str:
        """Its ID in the scene."""

    def now_ns(self) -> int:
        """Now on its clock."""

    def stamp(self, message: Any, frame_id: str) -> None:
        """Fill a header in where its sender left it."""

    def resolve(self, name: str) -> str:
        """The full name of a topic or service."""

    def create(self, kind: type[Kind], *names: str) -> Kind | None:
        """Another member."""

    def find(self, kind: type[Kind], *names: str) -> Kind | None:
        """The member of that kind and name."""

    def remove(self, member: "Member | None", what: str) -> bool:
        """Take a member out of graph and scene."""


class Member(_Node):
    """Mixed into a class of MRML nodes; `ROLE` and `key` say which of its ROS node's it is.

    A subclass gives `_start` (join the graph; raises `MarginGuardError`), `_stop` (leave it) and
    `spin` (bring what has come into the scene, in the thread that owns it).
    """

    ROLE = ""
    _owner: Owner | None = None

    def GetClassName(self) -> str:
        """The name that the class has in SlicerROS2; the scene itself knows the one below it."""
        return type(self).__name__

    def AddToROS2Node(self, nodeId: str, *names: str) -> bool:
        """Join the graph as part of the ROS node ``nodeId``; False, and said, when refused."""
        scene = self.GetScene()
        owner = None if scene is None else scene.GetNodeByID(nodeId)
        if owner is None or not hasattr(owner, "adopt"):
            logging.error(f"{self.GetClassName()}: no ROS 2 node {nodeId!r} in its scene")
            return False
        try:
            owner.adopt(self, names)
        except MarginGuardError as error:
            logging.error(str(error))
            return False
        return True

    def IsAddedToROS2Node(self) -> bool:
        """Whether it is part of a ROS node now."""
        return self._owner is not None

    def join(self, owner: Owner, names: tuple[str, ...]) -> None:
        """For the ROS node alone: become its member."""
        self._start(owner, *names)
        self._owner = owner
        self.SetNodeReferenceID("node", owner.GetID())

    def leave(self) -> None:
        """For the ROS node alone: be nobody's member."""
        if self._owner is not None:
            try:
                self._stop()
            finally:
                self._owner = None

    def status(self) -> str:
        """How it does, in a few words."""
        raise NotImplementedError

    def spin(self) -> None:
        """For the ROS node alone: bring what has come into the scene."""

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """What tells it from the others of its role on one ROS node."""
        raise NotImplementedError

    def _start(self, owner: Owner, *names: Any) -> None:
        raise NotImplementedError

    def _stop(self) -> None:
        raise NotImplementedError
