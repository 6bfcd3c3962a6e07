"""What publishers and subscribers have in common: a topic, its kind, its quality of service."""

from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.convert import qos_profile, type_name
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import Kind, kind_of
from ROS2Lib.member import Member, Owner

_RELIABILITY = {0: "reliable", 1: "reliable", 2: "best_effort"}
_DURABILITY = {0: "volatile", 1: "transient_local", 2: "volatile"}


class TopicNode(Member, vtkMRMLScriptedModuleNode):
    """A class of its own for each kind is made by `kind_class`."""

    KIND = ""
    ReliabilitySystemDefault, Reliable, BestEffort = range(3)
    DurabilitySystemDefault, TransientLocal, Volatile = range(3)

    def __init__(self) -> None:
        self.kind: Kind = kind_of(self.KIND)
        self._topic = ""
        self._depth = 10
        self._reliability = self.Reliable
        self._durability = self.Volatile

    def GetTopic(self) -> str:
        """The name as it was given."""
        return self._topic

    def GetROSType(self) -> str:
        """``geometry_msgs/msg/Pose``."""
        return type_name(self.kind.type)

    def GetSlicerType(self) -> str:
        """The class of the values."""
        blank = self.kind.blank()
        # Not the Python class: VTK puts its own below some of them.
        named = getattr(blank, "GetClassName", None)
        return type(blank).__name__ if named is None else str(named())

    def SetQoSHistoryDepth(self, depth: int) -> None:
        """How many messages wait at most; before it is added to a ROS node."""
        self._check_not_added()
        qos_profile(depth=depth)
        self._depth = depth

    def SetQoSReliability(self, policy: int) -> None:
        """`Reliable`, `BestEffort` or `ReliabilitySystemDefault` (reliable); before it is added."""
        self._check_not_added()
        if policy not in _RELIABILITY:
            raise Ros2Error(f"reliability {policy!r}: one of {sorted(_RELIABILITY)} wanted")
        self._reliability = policy

    def SetQoSDurability(self, policy: int) -> None:
        """`TransientLocal`, `Volatile` or `DurabilitySystemDefault` (volatile); before that too."""
        self._check_not_added()
        if policy not in _DURABILITY:
            raise Ros2Error(f"durability {policy!r}: one of {sorted(_DURABILITY)} wanted")
        self._durability = policy

    def GetQoSHistoryDepth(self) -> int:
        """How many messages wait at most."""
        return self._depth

    def GetQoSReliability(self) -> int:
        """One of the three."""
        return self._reliability

    def GetQoSDurability(self) -> int:
        """One of the three."""
        return self._durability

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The topic, however it was spelt."""
        return (owner.resolve(names[0]),)

    def quality(self) -> Any:
        """As it was set."""
        return qos_profile(
            depth=self._depth,
            reliability=_RELIABILITY[self._reliability],
            durability=_DURABILITY[self._durability],
        )

    def named(self, prefix: str, topic: str) -> None:
        """Carry the topic in name and attributes, which a saved scene keeps."""
        self._topic = topic
        self.SetName(f"{prefix}{topic}")
        self.SetModuleName("ROS2")
        self.SetAttribute("ros2.topic", topic)
        self.SetAttribute("ros2.type", self.GetROSType())

    def _check_not_added(self) -> None:
        if self.IsAddedToROS2Node():
            raise Ros2Error(f"{self._topic}: quality of service is set before it is added")
