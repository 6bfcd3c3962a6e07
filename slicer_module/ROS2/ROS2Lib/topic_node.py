"""Base of publishers and subscribers: topic, kind and quality of service."""

from typing import Any

from slicer import vtkMRMLScriptedModuleNode

from app.bridge.convert import qos_profile, type_name
from ROS2Lib.errors import Ros2Error
from ROS2Lib.kinds import Kind, kind_of
from ROS2Lib.member import Member, Owner

_RELIABILITY = {0: "reliable", 1: "reliable", 2: "best_effort"}
_DURABILITY = {0: "volatile", 1: "transient_local", 2: "volatile"}


class TopicNode(Member, vtkMRMLScriptedModuleNode):
    """Base class; `kind_class` derives one class per kind."""

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
        """The topic's name as given."""
        return self._topic

    def GetROSType(self) -> str:
        """``geometry_msgs/msg/Pose``."""
        return type_name(self.kind.type)

    def GetBlankMessage(self) -> Any:
        """An empty value of the kind."""
        return self.kind.blank()

    def GetSlicerType(self) -> str:
        """Class name of the values."""
        blank = self.kind.blank()
        # VTK returns subclasses of some classes, so the Python class name may differ.
        class_name = getattr(blank, "GetClassName", None)
        return type(blank).__name__ if class_name is None else str(class_name())

    def SetQoSHistoryDepth(self, depth: int) -> None:
        """Set the queue depth, before the node is added to a ROS node."""
        self._check_not_added()
        if not isinstance(depth, int):
            raise Ros2Error(f"history depth is {depth!r}; expected an integer")
        qos_profile(depth=depth)
        self._depth = depth

    def SetQoSReliability(self, policy: int) -> None:
        """Set `Reliable`, `BestEffort` or `ReliabilitySystemDefault`, before adding."""
        self._check_not_added()
        if policy not in _RELIABILITY:
            raise Ros2Error(f"reliability is {policy!r}; expected one of {sorted(_RELIABILITY)}")
        self._reliability = policy

    def SetQoSDurability(self, policy: int) -> None:
        """Set `TransientLocal`, `Volatile` or `DurabilitySystemDefault`, before adding."""
        self._check_not_added()
        if policy not in _DURABILITY:
            raise Ros2Error(f"durability is {policy!r}; expected one of {sorted(_DURABILITY)}")
        self._durability = policy

    def GetQoSHistoryDepth(self) -> int:
        """Queue depth."""
        return self._depth

    def GetQoSReliability(self) -> int:
        """Reliability policy."""
        return self._reliability

    def GetQoSDurability(self) -> int:
        """Durability policy."""
        return self._durability

    def settings(self) -> dict[str, Any]:
        """Quality of service."""
        return {
            "depth": self._depth,
            "reliability": self._reliability,
            "durability": self._durability,
        }

    def apply_settings(self, settings: dict[str, Any]) -> None:
        """Set the quality of service."""
        self.SetQoSHistoryDepth(settings["depth"])
        self.SetQoSReliability(settings["reliability"])
        self.SetQoSDurability(settings["durability"])

    @classmethod
    def key(cls, owner: Owner, *names: str) -> tuple[str, ...]:
        """The resolved name of the topic."""
        return (owner.resolve(names[0]),)

    def quality(self) -> Any:
        """Quality of service with the chosen settings."""
        return qos_profile(
            depth=self._depth,
            reliability=_RELIABILITY[self._reliability],
            durability=_DURABILITY[self._durability],
        )

    def set_topic(self, prefix: str, topic: str) -> None:
        """Store the topic in name and attributes, which a saved scene keeps."""
        self._topic = topic
        self.SetName(f"{prefix}{topic}")
        self.SetAttribute("ros2.topic", topic)
        self.SetAttribute("ros2.type", self.GetROSType())

    def _check_not_added(self) -> None:
        if self.IsAddedToROS2Node():
            raise Ros2Error(f"{self._topic}: quality of service must be set before it is added")
